#include "clients/calibrate_plan.h"

#include "core/segments.h"

#include <libconfig.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static bool is_kind(const config_setting_t *group, const char *kind)
{
    const char *word = NULL;
    return config_setting_lookup_string(group, "kind", &word) && strcmp(word, kind) == 0;
}

static bool names_channel(const config_setting_t *group, const char *channel)
{
    const config_setting_t *list = config_setting_get_member(group, "channels");
    for (int i = 0; list && i < config_setting_length(list); i++) {
        const char *name = config_setting_get_string_elem(list, i);
        if (name && strcmp(name, channel) == 0)
            return true;
    }
    return false;
}

/* Of the conditions the plan had itself, the first @n. */
static bool is_shown(const config_setting_t *conditions, int n, const char *kind,
                     const char *channel)
{
    for (int i = 0; i < n; i++) {
        const config_setting_t *group = config_setting_get_elem(conditions, (unsigned)i);
        if (is_kind(group, kind) && names_channel(group, channel))
            return true;
    }
    return false;
}

/* Keep nothing but the conditions that light several LEDs. */
static config_setting_t *keep_patterns(config_t *config)
{
    config_setting_t *root = config_root_setting(config);
    for (int i = config_setting_length(root); i-- > 0;) {
        const config_setting_t *s = config_setting_get_elem(root, (unsigned)i);
        if (strcmp(config_setting_name(s), "conditions") != 0 || !config_setting_is_list(s))
            config_setting_remove_elem(root, (unsigned)i);
    }
    config_setting_t *conditions = config_setting_get_member(root, "conditions");
    if (!conditions)
        return config_setting_add(root, "conditions", CONFIG_TYPE_LIST);
    for (int i = config_setting_length(conditions); i-- > 0;)
        if (is_kind(config_setting_get_elem(conditions, (unsigned)i), "each"))
            config_setting_remove_elem(conditions, (unsigned)i);
    return conditions;
}

static enum ls_err add_string(config_setting_t *parent, const char *name, const char *value)
{
    config_setting_t *s = config_setting_add(parent, name, CONFIG_TYPE_STRING);
    return s && config_setting_set_string(s, value) ? LS_OK : LS_ERR_NOMEM;
}

static enum ls_err add_int(config_setting_t *parent, const char *name, uint32_t value)
{
    config_setting_t *s = config_setting_add(parent, name, CONFIG_TYPE_INT);
    return s && config_setting_set_int(s, (int)value) ? LS_OK : LS_ERR_NOMEM;
}

/* A group of @kind in the rig's channels, those left out in which the plan has its own. @count: of
 * segments, else 0. */
static enum ls_err add_group(config_setting_t *conditions, int n_shown,
                             const struct lightstage_rig *rig, const char *kind, bool polarised,
                             uint32_t count)
{
    config_setting_t *group = config_setting_add(conditions, NULL, CONFIG_TYPE_GROUP);
    config_setting_t *channels =
        group ? config_setting_add(group, "channels", CONFIG_TYPE_ARRAY) : NULL;
    enum ls_err err = channels ? add_string(group, "kind", kind) : LS_ERR_NOMEM;
    if (!err && count)
        err = add_int(group, "count", count);
    for (size_t c = 0; c < rig->n_channels && !err; c++)
        if ((polarised || !rig->channels[c]->polariser) &&
            !is_shown(conditions, n_shown, kind, rig->channels[c]->name))
            err = add_string(channels, NULL, rig->channels[c]->name);
    if (!err && !config_setting_length(channels))
        config_setting_remove_elem(conditions, (unsigned)config_setting_length(conditions) - 1);
    return err;
}

static enum ls_err add_groups(const struct ls_calibrate_plan *plan,
                              const struct lightstage_rig *rig, config_t *config,
                              struct ls_diag *diag)
{
    config_setting_t *conditions = keep_patterns(config);
    int n = conditions ? config_setting_length(conditions) : 0;
    enum ls_err err = conditions ? add_group(conditions, n, rig, "sphere", true, 0) : LS_ERR_NOMEM;
    if (!err)
        err = add_group(conditions, 0, rig, "each", true, 0);
    if (!err && plan->segments > 0 && plan->segments <= rig->n_lights)
        err = add_group(conditions, n, rig, "segments", false, plan->segments);
    if (!err && rig->n_lights >= LS_HEADLIGHT_LIGHTS)
        err = add_group(conditions, n, rig, "headlight", false, 0);
    return err ? ls_fail(diag, err, "out of memory for a plan") : LS_OK;
}

static enum ls_err read_shown(const struct ls_calibrate_plan *plan, config_t *config,
                              struct ls_diag *diag)
{
    if (!plan->shown || config_read_string(config, plan->shown))
        return LS_OK;
    return ls_fail(diag, LS_ERR_INVALID, "%.200s:%d: %s", plan->shown_name,
                   config_error_line(config), config_error_text(config));
}

static enum ls_err write_text(const struct ls_calibrate_plan *plan, const config_t *config,
                              char **text, struct ls_diag *diag)
{
    size_t n = 0;
    FILE *out = open_memstream(text, &n);
    if (out) {
        fprintf(out, "subject = \"still\"; exposures_us = [%s]; darks = %u;\n", plan->exposures_us,
                plan->darks);
        config_write(config, out);
    }
    if (out && !fclose(out))
        return LS_OK;
    free(*text);
    *text = NULL;
    return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a plan");
}

enum ls_err ls_calibrate_plan_text(const struct ls_calibrate_plan *plan,
                                   const struct lightstage_rig *rig, char **text,
                                   struct ls_diag *diag)
{
    config_t config;
    config_init(&config);
    enum ls_err err = read_shown(plan, &config, diag);
    if (!err)
        err = add_groups(plan, rig, &config, diag);
    if (!err)
        err = write_text(plan, &config, text, diag);
    config_destroy(&config);
    return err;
}
