#include "daemon/conf_read.h"

#include <math.h>
#include <libgen.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

void ls_conf_begin(struct ls_conf *conf, const config_setting_t *group, const char *file,
                   struct ls_diag *diag)
{
    *conf = (struct ls_conf){.group = group, .file = file, .diag = diag};
}

unsigned ls_conf_line(const config_setting_t *setting)
{
    return setting ? config_setting_source_line(setting) : 0;
}

void ls_conf_error(struct ls_conf *conf, const char *key, const char *fmt, ...)
{
    if (conf->err)
        return;
    char what[384];
    va_list args;
    va_start(args, fmt);
    vsnprintf(what, sizeof what, fmt, args);
    va_end(args);
    const config_setting_t *at = conf->group ? config_setting_get_member(conf->group, key) : NULL;
    unsigned line = ls_conf_line(at ? at : conf->group);
    conf->err =
        line ? ls_fail(conf->diag, LS_ERR_INVALID, "%s:%u: %s: %s", conf->file, line, key, what)
             : ls_fail(conf->diag, LS_ERR_INVALID, "%s: %s: %s", conf->file, key, what);
}

static const config_setting_t *get(struct ls_conf *conf, const char *key, bool needed)
{
    if (conf->n_known < LS_CONF_MAX_KEYS)
        conf->known[conf->n_known++] = key;
    if (conf->err)
        return NULL;
    const config_setting_t *s = conf->group ? config_setting_get_member(conf->group, key) : NULL;
    if (!s && needed)
        ls_conf_error(conf, key, "missing, and there is no default");
    return s;
}

enum ls_err ls_conf_finish(struct ls_conf *conf)
{
    int n = conf->group ? config_setting_length(conf->group) : 0;
    for (int i = 0; i < n && !conf->err; i++) {
        const config_setting_t *s = config_setting_get_elem(conf->group, i);
        const char *name = config_setting_name(s);
        bool known = false;
        for (unsigned k = 0; k < conf->n_known; k++)
            known |= !strcmp(name, conf->known[k]);
        if (known)
            continue;
        char expected[256] = "";
        for (unsigned k = 0; k < conf->n_known; k++) {
            size_t used = strlen(expected);
            snprintf(expected + used, sizeof expected - used, "%s%s", k ? ", " : "",
                     conf->known[k]);
        }
        conf->err = ls_fail(conf->diag, LS_ERR_INVALID, "%s:%u: unknown key %s: expected one of %s",
                            conf->file, ls_conf_line(s), name, expected);
    }
    return conf->err;
}

static double number(struct ls_conf *conf, const char *key, double fallback, double min, double max,
                     bool needed)
{
    const config_setting_t *s = get(conf, key, needed);
    if (!s)
        return fallback;
    double v;
    switch (config_setting_type(s)) {
    case CONFIG_TYPE_INT:
    case CONFIG_TYPE_INT64:
        v = (double)config_setting_get_int64(s);
        break;
    case CONFIG_TYPE_FLOAT:
        v = config_setting_get_float(s);
        break;
    default:
        ls_conf_error(conf, key, "expected a number");
        return fallback;
    }
    if (!(v >= min && v <= max)) {
        ls_conf_error(conf, key, "%g: expected %g to %g", v, min, max);
        return fallback;
    }
    return v;
}

double ls_conf_number(struct ls_conf *conf, const char *key, double fallback, double min,
                      double max)
{
    return number(conf, key, fallback, min, max, false);
}

double ls_conf_need_number(struct ls_conf *conf, const char *key, double min, double max)
{
    return number(conf, key, min, min, max, true);
}

int64_t ls_conf_int(struct ls_conf *conf, const char *key, int64_t fallback, int64_t min,
                    int64_t max)
{
    double v = number(conf, key, (double)fallback, (double)min, (double)max, false);
    if (v != floor(v)) {
        ls_conf_error(conf, key, "%g: expected a whole number", v);
        return fallback;
    }
    return (int64_t)v;
}

bool ls_conf_bool(struct ls_conf *conf, const char *key, bool fallback)
{
    const config_setting_t *s = get(conf, key, false);
    if (!s)
        return fallback;
    if (config_setting_type(s) != CONFIG_TYPE_BOOL) {
        ls_conf_error(conf, key, "expected true or false");
        return fallback;
    }
    return config_setting_get_bool(s);
}

static char *string(struct ls_conf *conf, const char *key, const char *fallback, bool needed)
{
    const config_setting_t *s = get(conf, key, needed);
    const char *v = fallback;
    if (s && config_setting_type(s) != CONFIG_TYPE_STRING)
        ls_conf_error(conf, key, "expected a string in double quotes");
    else if (s)
        v = config_setting_get_string(s);
    if (!v || conf->err)
        return NULL;
    char *copy = strdup(v);
    if (!copy)
        conf->err = ls_fail(conf->diag, LS_ERR_NOMEM, "out of memory reading %s", conf->file);
    return copy;
}

char *ls_conf_string(struct ls_conf *conf, const char *key, const char *fallback)
{
    return string(conf, key, fallback, false);
}

char *ls_conf_need_string(struct ls_conf *conf, const char *key)
{
    return string(conf, key, NULL, true);
}

int ls_conf_word(struct ls_conf *conf, const char *key, const char *const *words, int fallback)
{
    LS_CLEANUP_FREE char *v = string(conf, key, NULL, false);
    if (conf->err || (!v && fallback >= 0))
        return fallback < 0 ? 0 : fallback;
    char expected[128] = "";
    for (int i = 0; words[i]; i++) {
        if (v && !strcmp(v, words[i]))
            return i;
        size_t used = strlen(expected);
        snprintf(expected + used, sizeof expected - used, "%s\"%s\"", i ? " or " : "", words[i]);
    }
    if (v)
        ls_conf_error(conf, key, "\"%s\": expected %s", v, expected);
    else
        ls_conf_error(conf, key, "missing, and there is no default: expected %s", expected);
    return 0;
}

bool ls_conf_numbers(struct ls_conf *conf, const char *key, double *out, unsigned n, bool needed)
{
    const config_setting_t *s = get(conf, key, needed);
    if (!s)
        return false;
    if (!config_setting_is_aggregate(s) || config_setting_length(s) != (int)n) {
        ls_conf_error(conf, key, "expected %u numbers in brackets", n);
        return false;
    }
    for (unsigned i = 0; i < n; i++) {
        const config_setting_t *e = config_setting_get_elem(s, i);
        if (!config_setting_is_number(e)) {
            ls_conf_error(conf, key, "expected %u numbers in brackets", n);
            return false;
        }
        out[i] = config_setting_type(e) == CONFIG_TYPE_FLOAT ? config_setting_get_float(e)
                                                             : (double)config_setting_get_int64(e);
    }
    return true;
}

const config_setting_t *ls_conf_child(struct ls_conf *conf, const char *key, int type, bool needed)
{
    const config_setting_t *s = get(conf, key, needed);
    if (s && config_setting_type(s) != type) {
        ls_conf_error(conf, key, "expected %s",
                      type == CONFIG_TYPE_GROUP  ? "a group { ... }"
                      : type == CONFIG_TYPE_LIST ? "a list ( ... )"
                                                 : "an array [ ... ]");
        return NULL;
    }
    return s;
}

char *ls_conf_beside(const char *file, char *path)
{
    if (!path || path[0] == '/')
        return path;
    LS_CLEANUP_FREE char *copy = strdup(file);
    char *joined = NULL;
    if (copy && asprintf(&joined, "%s/%s", dirname(copy), path) < 0)
        joined = NULL;
    free(path);
    return joined;
}
