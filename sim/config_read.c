#include "sim/config_read.h"

#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

enum ls_err sim_config_fail(const config_setting_t *setting, struct ls_diag *diag, const char *fmt,
                            ...)
{
    char text[384];
    const char *file = config_setting_source_file(setting);
    va_list args;
    va_start(args, fmt);
    vsnprintf(text, sizeof text, fmt, args);
    va_end(args);
    return ls_fail(diag, LS_ERR_INVALID, "%s:%u: %s", file ? file : "configuration",
                   config_setting_source_line(setting), text);
}

int sim_config_choice(const char *choices, const char *word)
{
    size_t length = strlen(word);
    for (int index = 0; *choices; index++) {
        size_t n = strcspn(choices, " ");
        if (n == length && !memcmp(choices, word, n))
            return index;
        choices += n + strspn(choices + n, " ");
    }
    return -1;
}

static bool is_number(const config_setting_t *s)
{
    int type = config_setting_type(s);
    return type == CONFIG_TYPE_INT || type == CONFIG_TYPE_INT64 || type == CONFIG_TYPE_FLOAT;
}

static double number_of(const config_setting_t *s)
{
    if (config_setting_type(s) == CONFIG_TYPE_FLOAT)
        return config_setting_get_float(s);
    return (double)config_setting_get_int64(s);
}

static enum ls_err read_integer(const config_setting_t *s, const struct sim_key *key, void *field,
                                struct ls_diag *diag)
{
    bool integer = is_number(s) && config_setting_type(s) != CONFIG_TYPE_FLOAT;
    double value = integer ? number_of(s) : 0;
    if (!integer || value < key->min || value > key->max)
        return sim_config_fail(s, diag, "%s: expected a whole number in %.15g..%.15g", key->name,
                               key->min, key->max);
    if (key->type == SIM_KEY_U64)
        *(uint64_t *)field = (uint64_t)config_setting_get_int64(s);
    else if (key->type == SIM_KEY_I32)
        *(int32_t *)field = (int32_t)config_setting_get_int64(s);
    else
        *(uint32_t *)field = (uint32_t)config_setting_get_int64(s);
    return LS_OK;
}

static enum ls_err read_double(const config_setting_t *s, const struct sim_key *key, void *field,
                               struct ls_diag *diag)
{
    double value = is_number(s) ? number_of(s) : 0;
    if (!is_number(s) || !(value >= key->min && value <= key->max))
        return sim_config_fail(s, diag, "%s: expected a number in %.15g..%.15g", key->name,
                               key->min, key->max);
    *(double *)field = value;
    return LS_OK;
}

static enum ls_err read_vector(const config_setting_t *s, const struct sim_key *key, void *field,
                               struct ls_diag *diag)
{
    bool three = config_setting_is_aggregate(s) == CONFIG_TRUE && config_setting_length(s) == 3;
    for (unsigned i = 0; three && i < 3; i++)
        three = is_number(config_setting_get_elem(s, i));
    if (!three)
        return sim_config_fail(
            s, diag, "%s: expected three numbers in metres, e.g. [0.0, 0.0, 1.6]", key->name);
    for (unsigned i = 0; i < 3; i++)
        ((double *)field)[i] = number_of(config_setting_get_elem(s, i));
    return LS_OK;
}

/** @text, or @text in the folder of the file it was read from. */
static bool place(const config_setting_t *s, const char *text, char *out, size_t size)
{
    const char *file = config_setting_source_file(s);
    const char *slash = file ? strrchr(file, '/') : NULL;
    int folder = slash && text[0] && text[0] != '/' ? (int)(slash - file) + 1 : 0;
    return (size_t)snprintf(out, size, "%.*s%s", folder, folder ? file : "", text) < size;
}

static enum ls_err read_text(const config_setting_t *s, const struct sim_key *key, void *field,
                             struct ls_diag *diag)
{
    const char *text = config_setting_get_string(s);
    if (!text)
        return sim_config_fail(s, diag, "%s: expected a string%s%s", key->name,
                               key->choices ? ", one of: " : "", key->choices ? key->choices : "");
    if (key->type == SIM_KEY_PATH) {
        if (!place(s, text, field, key->size))
            return sim_config_fail(s, diag, "%s: path too long", key->name);
        return LS_OK;
    }
    int choice = key->choices ? sim_config_choice(key->choices, text) : 0;
    if (choice < 0)
        return sim_config_fail(s, diag, "%s: \"%.60s\": expected one of: %s", key->name, text,
                               key->choices);
    if (key->type == SIM_KEY_CHOICE) {
        *(uint32_t *)field = (uint32_t)choice;
        return LS_OK;
    }
    if ((size_t)snprintf(field, key->size, "%s", text) >= key->size)
        return sim_config_fail(s, diag, "%s: expected at most %zu characters", key->name,
                               key->size - 1);
    return LS_OK;
}

static enum ls_err read_bool(const config_setting_t *s, const struct sim_key *key, void *field,
                             struct ls_diag *diag)
{
    if (config_setting_type(s) != CONFIG_TYPE_BOOL)
        return sim_config_fail(s, diag, "%s: expected true or false", key->name);
    *(bool *)field = config_setting_get_bool(s);
    return LS_OK;
}

static enum ls_err read_key(const config_setting_t *s, const struct sim_key *key, void *target,
                            struct ls_diag *diag)
{
    void *field = (char *)target + key->offset;
    switch (key->type) {
    case SIM_KEY_U32:
    case SIM_KEY_U64:
    case SIM_KEY_I32:
        return read_integer(s, key, field, diag);
    case SIM_KEY_DOUBLE:
        return read_double(s, key, field, diag);
    case SIM_KEY_BOOL:
        return read_bool(s, key, field, diag);
    case SIM_KEY_STRING:
    case SIM_KEY_PATH:
    case SIM_KEY_CHOICE:
        return read_text(s, key, field, diag);
    case SIM_KEY_VECTOR:
        return read_vector(s, key, field, diag);
    case SIM_KEY_OTHER:
        break;
    }
    return LS_OK;
}

static enum ls_err unknown(const config_setting_t *s, const struct sim_key *keys,
                           struct ls_diag *diag)
{
    char known[320] = "";
    size_t at = 0;
    for (; keys->name && at < sizeof known; keys++)
        at += (size_t)snprintf(known + at, sizeof known - at, "%s%s", at ? " " : "", keys->name);
    return sim_config_fail(s, diag, "unknown key \"%.40s\": expected one of: %s",
                           config_setting_name(s), known);
}

enum ls_err sim_config_read(const config_setting_t *group, const struct sim_key *keys, void *target,
                            struct ls_diag *diag)
{
    if (config_setting_type(group) != CONFIG_TYPE_GROUP)
        return sim_config_fail(group, diag, "expected a group { key = value; ... }");
    for (int i = 0; i < config_setting_length(group); i++) {
        const config_setting_t *s = config_setting_get_elem(group, (unsigned)i);
        const struct sim_key *key = keys;
        while (key->name && strcmp(key->name, config_setting_name(s)))
            key++;
        enum ls_err err = key->name ? read_key(s, key, target, diag) : unknown(s, keys, diag);
        if (err)
            return err;
    }
    return LS_OK;
}
