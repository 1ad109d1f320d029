#include "daemon/take_private.h"

#include "daemon/bracket.h"
#include "daemon/led_record.h"
#include "daemon/preflight.h"
#include "daemon/take_json.h"
#include "daemon/takedir.h"

#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/statvfs.h>
#include <time.h>

static double reference_exposure_s(const struct ls_take *take)
{
    const struct ls_config_camera *c = &take->context->config->cameras[0];
    double offset = c->driver.exposure == LS_EXPOSURE_WIDTH ? c->exposure_offset_us : 0;
    return (take->plan->pulse_us[take->plan->n_exposures - 1] + offset) * 1e-6;
}

static enum ls_err preflight(struct ls_take *take, struct ls_preflight *out, uint64_t *need_bytes,
                             struct ls_diag *diag)
{
    const struct ls_config *config = take->context->config;
    struct statvfs fs;
    if (statvfs(config->storage, &fs))
        return ls_fail(diag, LS_ERR_NOT_FOUND, "storage folder %s: %m", config->storage);
    struct ls_lights_status status;
    struct ls_step_event event;
    size_t n_events;
    enum ls_err err = ls_lights_poll(take->rig.lights, &status, &event, 1, &n_events, diag);
    if (err)
        return err;
    const struct ls_preflight_input in = {
        .config = config,
        .plan = take->plan,
        .status = &status,
        .lights = ls_lights_info(take->rig.lights),
        .cameras = take->rig.camera_infos,
        .calibration = take->context->calibration,
        .disk_free_bytes = (uint64_t)fs.f_bavail * fs.f_frsize,
        .condition_done = take->resumed.done,
        .led_record = take->led_record,
    };
    *need_bytes = ls_preflight_bytes(&in);
    return ls_preflight_check(&in, out, diag);
}

static struct ls_take_document document(const struct ls_take *take, const char *plan_text)
{
    return (struct ls_take_document){
        .config = take->context->config,
        .plan = take->plan,
        .plan_text = plan_text,
        .lights = ls_lights_info(take->rig.lights),
        .cameras = take->rig.camera_infos,
        .reference_exposure_s = reference_exposure_s(take),
        .calibration_json = take->context->calibration_json,
        .calibration = take->context->calibration,
        .led_record = take->led_record,
    };
}

static enum ls_err continue_from(struct ls_take *take, const struct ls_takedir *dir,
                                 const char *plan_text, const _Atomic bool *stop,
                                 struct ls_diag *diag)
{
    const struct ls_take_document doc = document(take, plan_text);
    enum ls_err err = ls_take_json_same_rig(dir->take_json, &doc, diag);
    const struct ls_resumed_input in = {
        .dir = dir,
        .plan = take->plan,
        .cameras = take->rig.camera_infos,
        .n_cameras = take->config.n_cameras,
        .checks = take->checks,
        .stop = stop,
    };
    return err ? err : ls_resumed_find(&in, &take->resumed, diag);
}

/* Plan, devices, and for a take on disk (@dir, else NULL) what of it is done; then preflight. */
static enum ls_err prepare(const struct ls_take_context *context, const char *plan_text,
                           const struct ls_takedir *dir, const _Atomic bool *stop,
                           struct ls_take **out, struct ls_preflight *report, uint64_t *need_bytes,
                           struct ls_diag *diag)
{
    struct ls_take *take = calloc(1, sizeof *take);
    if (!take)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    take->config = *context->config;
    take->own = *context;
    take->own.config = &take->config;
    take->context = &take->own;
    enum ls_err err = ls_plan_parse(plan_text, context->config, &take->plan, diag);
    if (!err)
        err = ls_led_record_read(context->config->storage, &take->led_record, diag);
    if (!err)
        err = ls_rig_open(context->config, stop, &take->rig, diag);
    if (!err) {
        ls_plan_fit_current(take->plan, ls_lights_info(take->rig.lights));
        for (uint32_t i = 0; i < take->config.n_cameras; i++)
            take->config.cameras[i].driver.exposure = take->rig.camera_infos[i]->exposure;
        ls_bracket_choose(take->plan, &take->config);
    }
    take->checks = err ? NULL : ls_checks_create(context->config, take->plan);
    if (!err && !take->checks)
        err = ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    if (!err && dir)
        err = ls_take_json_offsets(dir->take_json, &take->config, diag);
    if (!err && dir)
        err = continue_from(take, dir, plan_text, stop, diag);
    if (!err)
        err = preflight(take, report, need_bytes, diag);
    if ((!err || err == LS_ERR_ABORTED) && stop && atomic_load(stop))
        err = ls_fail(diag, LS_ERR_ABORTED,
                      "given up: it was aborted, all lights were turned off, or the daemon ends");
    if (err) {
        ls_take_destroy(take);
        return err;
    }
    *out = take;
    return LS_OK;
}

enum ls_err ls_take_preflight(const struct ls_take_context *context, const char *plan_text,
                              const _Atomic bool *stop, struct ls_preflight *out,
                              struct ls_diag *diag)
{
    struct ls_take *take;
    uint64_t need_bytes;
    enum ls_err err = prepare(context, plan_text, NULL, stop, &take, out, &need_bytes, diag);
    if (!err)
        ls_take_destroy(take);
    return err;
}

static enum ls_err create_store(struct ls_take *take, const char *name, const char *take_json,
                                uint64_t need_bytes, struct ls_diag *diag)
{
    const struct ls_config *config = take->context->config;
    const char **ids = calloc(take->plan->n_conditions, sizeof *ids);
    if (!ids)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; i < take->plan->n_conditions; i++)
        ids[i] = take->plan->conditions[i].id;
    const struct ls_store_config store = {
        .root = config->storage,
        .name = name,
        .take_json = take_json,
        .utc_s = time(NULL),
        .n_cameras = config->n_cameras,
        .n_shots = take->plan->n_steps * config->n_cameras,
        .conditions = ids,
        .n_conditions = take->plan->n_conditions,
        .keep_raw = take->plan->keep_raw,
        .need_bytes = need_bytes,
        .spare_bytes = config->reserve_bytes,
    };
    enum ls_err err = ls_store_create(&store, &take->store, diag);
    free(ids);
    return err;
}

/* ---- what clients are told ---- */

static const struct ls_plan_condition *find_condition(const struct ls_plan *plan, const char *id)
{
    uint32_t i = 0;
    while (i < plan->n_conditions && strcmp(plan->conditions[i].id, id) != 0)
        i++;
    return i < plan->n_conditions ? &plan->conditions[i] : NULL;
}

/* On ls-store. Darks are no pictures of lights. */
static void tell_published(void *user, const char *id, uint32_t camera)
{
    const struct ls_take *take = user;
    const struct ls_plan_condition *c = find_condition(take->plan, id);
    struct ls_event_picture picture = {.camera = camera, .light = -1};
    if (!c || c->dark)
        return;
    snprintf(picture.condition, sizeof picture.condition, "%s", id);
    picture.light = c->light;
    if (c->channel >= 0)
        snprintf(picture.channel, sizeof picture.channel, "%s",
                 take->context->config->channels[c->channel].name);
    ls_events_published(take->context->events, &picture);
}

/* @dir: what is published already, or NULL. */
static void tell_begin(struct ls_take *take, const struct ls_takedir *dir)
{
    ls_events_begin(take->context->events, ls_take_id(take));
    for (size_t i = 0; dir && i < dir->n_published; i++)
        tell_published(take, dir->published[i].condition, dir->published[i].camera);
    ls_store_tell(take->store, tell_published, take);
}

static enum ls_err create_capture(struct ls_take *take, struct ls_diag *diag)
{
    const struct ls_capture_setup setup = {
        .config = take->context->config,
        .plan = take->plan,
        .lights = take->rig.lights,
        .cameras = take->rig.cameras,
        .store = take->store,
        .metrics = take->context->metrics,
        .preview = take->context->preview,
        .checks = take->checks,
        .reference_exposure_s = reference_exposure_s(take),
        .condition_done = take->resumed.done,
        .darks = (const float *const *)take->resumed.darks,
        .defects = take->resumed.done ? take->resumed.defects : NULL,
    };
    ls_store_limit_queue(take->store, take->context->config->queue_bytes);
    return ls_capture_create(&setup, &take->capture, diag);
}

enum ls_err ls_take_create(const struct ls_take_context *context, const char *name,
                           const char *plan_text, const char *token, const _Atomic bool *stop,
                           struct ls_take **out, struct ls_diag *diag)
{
    struct ls_take *take;
    struct ls_preflight report;
    uint64_t need_bytes;
    enum ls_err err = prepare(context, plan_text, NULL, stop, &take, &report, &need_bytes, diag);
    if (err)
        return err;
    struct ls_take_document doc = document(take, plan_text);
    doc.token = token;
    doc.preflight = &report;
    LS_CLEANUP_FREE char *take_json = NULL;
    err = ls_take_json_make(&doc, &take_json, diag);
    if (!err)
        err = create_store(take, name, take_json, need_bytes, diag);
    if (!err)
        err = create_capture(take, diag);
    if (err) {
        ls_take_destroy(take);
        return err;
    }
    tell_begin(take, NULL);
    *out = take;
    return LS_OK;
}

static enum ls_err reopen(const struct ls_take_context *context, const struct ls_takedir *dir,
                          const _Atomic bool *stop, struct ls_take **out, struct ls_diag *diag)
{
    LS_CLEANUP_FREE char *plan_text = NULL;
    enum ls_err err = ls_take_json_plan(dir->take_json, &plan_text, diag);
    struct ls_take *take = NULL;
    struct ls_preflight report;
    uint64_t need_bytes;
    if (!err)
        err = prepare(context, plan_text, dir, stop, &take, &report, &need_bytes, diag);
    if (err)
        return err;
    err = ls_store_reopen(dir->folder, need_bytes, context->config->reserve_bytes, NULL,
                          &take->store, diag);
    if (!err)
        err = create_capture(take, diag);
    if (err) {
        ls_take_destroy(take);
        return err;
    }
    tell_begin(take, dir);
    *out = take;
    return LS_OK;
}

enum ls_err ls_take_reopen(const struct ls_take_context *context, const char *id,
                           const _Atomic bool *stop, struct ls_take **out, struct ls_diag *diag)
{
    LS_CLEANUP_FREE char *folder = NULL;
    struct ls_takedir *dir = NULL;
    if (!ls_takedir_id_ok(id))
        return ls_fail(diag, LS_ERR_INVALID,
                       "\"%.80s\" is no take: expected a name as `take list` prints it", id);
    if (asprintf(&folder, "%s/%s", context->config->storage, id) < 0)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    enum ls_err err = ls_takedir_open(folder, &dir, diag);
    if (err)
        return err;
    err = dir->state == LS_STORE_COMPLETE
              ? ls_fail(diag, LS_ERR_STATE, "take %s is complete: nothing to resume", id)
              : reopen(context, dir, stop, out, diag);
    ls_takedir_close(dir);
    return err;
}
