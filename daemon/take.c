#include "daemon/take.h"

#include "core/exr.h"
#include "core/half.h"
#include "core/hot_pixels.h"
#include "core/pixel.h"
#include "daemon/bracket.h"
#include "daemon/findings.h"
#include "daemon/led_record.h"
#include "daemon/preflight.h"
#include "daemon/rig.h"
#include "daemon/store.h"
#include "daemon/take_json.h"
#include "daemon/takedir.h"

#include <jansson.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/statvfs.h>
#include <time.h>

enum { DARK_LIMIT_BYTES = 1 << 30 };

struct ls_take {
    const struct ls_take_context *context; /* `own` */
    struct ls_take_context own;
    struct ls_config config; /* the configuration, how each camera exposes, and offsets an earlier
                                run measured; strings are its */
    struct ls_plan *plan;
    struct ls_rig rig;
    struct ls_store *store;
    struct ls_checks *checks;
    json_t *led_record; /* of the last sweep, NULL if there is none */
    char said[384];     /* by the checks of a sweep */
    struct ls_capture *capture;
    uint8_t *done; /* per condition, of a resumed take */
    float **darks; /* [camera * n_exposures + exposure], of a resumed take */
    struct ls_pixel_list defects[LS_MAX_CAMERAS]; /* found in these */
};

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
        .condition_done = take->done,
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

/* The published validity of a dark: its defective pixels, also those that its mean does not show.
 */
static enum ls_err load_defects(struct ls_take *take, const struct ls_published *published,
                                const void *bytes, size_t n_bytes, uint32_t camera,
                                struct ls_diag *diag)
{
    struct ls_exr_plane plane;
    struct ls_pixel_list list = {0};
    enum ls_err err = ls_exr_read_plane(bytes, n_bytes, "validity", DARK_LIMIT_BYTES, &plane, NULL);
    if (err == LS_ERR_NOT_FOUND)
        return LS_OK;
    if (!err && plane.type != LS_EXR_HALF)
        err = LS_ERR_INVALID;
    if (err)
        return ls_fail(diag, err, "%s: its validity cannot be read", published->file);
    uint32_t n = plane.width * plane.height; /* as the journal says it, checked before */
    list.index = malloc((n + 1) * sizeof *list.index);
    for (uint32_t i = 0; list.index && i < n; i++)
        if (((const uint16_t *)plane.samples)[i])
            list.index[list.n++] = i;
    err = list.index ? ls_pixel_list_join(&take->defects[camera], &list) : LS_ERR_NOMEM;
    ls_pixel_list_finish(&list);
    free(plane.samples);
    return err ? ls_fail(diag, err, "out of memory") : LS_OK;
}

static enum ls_err load_dark(struct ls_take *take, const struct ls_takedir *dir,
                             const struct ls_published *published, uint32_t camera,
                             uint32_t exposure, struct ls_diag *diag)
{
    LS_CLEANUP_FREE uint8_t *bytes = NULL;
    size_t n_bytes = 0;
    struct ls_image image = {0};
    enum ls_err err = ls_takedir_read(dir, published, &bytes, &n_bytes, diag);
    if (!err)
        err = ls_published_check(published, bytes, n_bytes, diag);
    if (!err)
        err = ls_exr_read(bytes, n_bytes, NULL, DARK_LIMIT_BYTES, &image, NULL, diag);
    const struct ls_camera_info *info = take->rig.camera_infos[camera];
    if (!err &&
        (image.width != info->width || image.height != info->height || image.n_channels != 1))
        err = ls_fail(diag, LS_ERR_MISMATCH, "%s: %ux%u, the camera gives %ux%u", published->file,
                      image.width, image.height, info->width, info->height);
    if (err) {
        ls_image_finish(&image);
        return err;
    }
    take->darks[camera * take->plan->n_exposures + exposure] = image.pixels;
    return load_defects(take, published, bytes, n_bytes, camera, diag);
}

/* A reference of an earlier run: what comes is compared with it. */
static enum ls_err load_reference(struct ls_take *take, const struct ls_takedir *dir,
                                  const struct ls_published *published, uint32_t camera,
                                  uint32_t condition, struct ls_diag *diag)
{
    LS_CLEANUP_FREE uint8_t *bytes = NULL;
    size_t n_bytes = 0, n_px = (size_t)published->width * published->height;
    struct ls_exr_plane mosaic = {0}, validity = {0};
    const struct ls_pixel_format *format =
        ls_pixel_by_name(take->rig.camera_infos[camera]->pixel_format);
    enum ls_err err = ls_takedir_read(dir, published, &bytes, &n_bytes, diag);
    if (!err)
        err = ls_published_check(published, bytes, n_bytes, diag);
    if (!err)
        err = ls_exr_read_plane(bytes, n_bytes, NULL, DARK_LIMIT_BYTES, &mosaic, diag);
    if (!err && published->tile_invalid)
        err = ls_exr_read_plane(bytes, n_bytes, "validity", DARK_LIMIT_BYTES, &validity, diag);
    LS_CLEANUP_FREE uint8_t *states = validity.samples ? malloc(n_px) : NULL;
    for (size_t i = 0; states && i < n_px; i++)
        states[i] = (uint8_t)ls_half_to_float(((const uint16_t *)validity.samples)[i]);
    const struct ls_picture_view view = {mosaic.samples, states, published->width,
                                         published->height, format ? format->cfa : LS_CFA_NONE};
    if (!err && validity.samples && !states)
        err = ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    if (!err)
        err = ls_checks_adopt(take->checks, camera, condition, &view, diag);
    free(mosaic.samples);
    free(validity.samples);
    return err;
}

static bool is_stopped(const _Atomic bool *stop)
{
    return stop && atomic_load(stop);
}

static enum ls_err given_up(struct ls_diag *diag)
{
    return ls_fail(diag, LS_ERR_ABORTED,
                   "given up: it was aborted, all lights were turned off, or the daemon ends");
}

/* A condition is done when every camera's picture of it is published. */
static enum ls_err find_done(struct ls_take *take, const struct ls_takedir *dir,
                             const _Atomic bool *stop, struct ls_diag *diag)
{
    const struct ls_plan *plan = take->plan;
    uint32_t n_cameras = take->context->config->n_cameras;
    take->done = calloc(plan->n_conditions, sizeof *take->done);
    take->darks = calloc((size_t)n_cameras * plan->n_exposures, sizeof *take->darks);
    if (!take->done || !take->darks)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; i < plan->n_conditions; i++) {
        if (is_stopped(stop))
            return given_up(diag);
        take->done[i] = 1;
        for (uint32_t k = 0; k < n_cameras; k++) {
            const struct ls_published *p = ls_takedir_find(dir, plan->conditions[i].id, k);
            take->done[i] &= p != NULL;
            enum ls_err err = LS_OK;
            if (p && plan->conditions[i].dark && !plan->conditions[i].watch)
                err = load_dark(take, dir, p, k, plan->conditions[i].exposure, diag);
            else if (p && plan->conditions[i].reference)
                err = load_reference(take, dir, p, k, i, diag);
            if (err)
                return err;
        }
    }
    return LS_OK;
}

static enum ls_err continue_from(struct ls_take *take, const struct ls_takedir *dir,
                                 const char *plan_text, const _Atomic bool *stop,
                                 struct ls_diag *diag)
{
    const struct ls_take_document doc = document(take, plan_text);
    enum ls_err err = ls_take_json_same_rig(dir->take_json, &doc, diag);
    return err ? err : find_done(take, dir, stop, diag);
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
    if (!err && is_stopped(stop))
        err = given_up(diag);
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
        .condition_done = take->done,
        .darks = (const float *const *)take->darks,
        .defects = take->done ? take->defects : NULL,
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

const char *ls_take_id(const struct ls_take *take)
{
    return ls_store_id(take->store);
}

/* "cam0/W-0137" of everything not published; NULL-terminated, (transfer full). */
static char **list_missing(const struct ls_take *take, const struct ls_takedir *dir, size_t *n)
{
    uint32_t n_cameras = take->context->config->n_cameras;
    char **out = calloc((size_t)take->plan->n_conditions * n_cameras + 1, sizeof *out);
    *n = 0;
    for (uint32_t i = 0; out && i < take->plan->n_conditions; i++)
        for (uint32_t k = 0; k < n_cameras; k++)
            if (!ls_takedir_find(dir, take->plan->conditions[i].id, k) &&
                asprintf(&out[*n], "cam%u/%s", k, take->plan->conditions[i].id) > 0)
                (*n)++;
    return out;
}

static enum ls_take_state end_state(enum ls_err err, size_t n_missing)
{
    if (err == LS_ERR_ABORTED)
        return LS_TAKE_ABORTED;
    if (err)
        return LS_TAKE_FAILED;
    return n_missing ? LS_TAKE_INCOMPLETE : LS_TAKE_COMPLETE;
}

static enum ls_store_state store_state(enum ls_take_state state)
{
    switch (state) {
    case LS_TAKE_COMPLETE:
        return LS_STORE_COMPLETE;
    case LS_TAKE_INCOMPLETE:
        return LS_STORE_INCOMPLETE;
    case LS_TAKE_ABORTED:
        return LS_STORE_ABORTED;
    default:
        return LS_STORE_FAILED;
    }
}

/* A sweep is made for its warnings: they go to the journal and into the take's message. */
static enum ls_err say_warnings(struct ls_take *take, const json_t *checks, struct ls_diag *diag)
{
    const json_t *warnings = json_object_get(checks, "warnings");
    enum ls_err err = LS_OK;
    snprintf(take->said, sizeof take->said, "; nothing wrong was found");
    for (size_t i = 0; i < json_array_size(warnings) && !err; i++) {
        const char *text = json_string_value(json_array_get(warnings, i));
        size_t used = i ? strlen(take->said) : 0;
        snprintf(take->said + used, sizeof take->said - used, "; %s", text);
        err = ls_store_alarm(take->store, text, diag);
    }
    ls_events_alarm(take->context->events, LS_ALARM_SWEEP, json_array_size(warnings) > 0,
                    ls_take_id(take), take->said + 2);
    return err;
}

/* For the takes to come. A disk that does not take it is no fault of this one. */
static enum ls_err keep_record(struct ls_take *take, const json_t *checks, struct ls_diag *diag)
{
    struct ls_diag why = {{0}};
    if (!ls_led_record_write(take->context->config->storage, ls_take_id(take), checks, &why))
        return LS_OK;
    return ls_store_alarm(take->store, why.text, diag);
}

static enum ls_err put_findings(struct ls_take *take, const char *take_json, bool complete,
                                char **text, struct ls_diag *diag)
{
    struct ls_findings findings;
    LS_CLEANUP_FREE char *found = NULL;
    json_t *checks = NULL;
    ls_capture_findings(take->capture, &findings);
    enum ls_err err = ls_findings_put(&findings, take_json, &found, diag);
    if (!err)
        err = ls_checks_conclude(take->checks, &findings, &checks, diag);
    if (!err && checks && take->plan->sweep)
        err = say_warnings(take, checks, diag);
    if (!err && checks && take->plan->sweep && complete)
        err = keep_record(take, checks, diag);
    if (!err)
        err = ls_checks_put(take->checks, checks, found, text, diag);
    json_decref(checks);
    return err;
}

/* Say in take.json how it ended, what is missing and what was found; that itself can fail (disk
 * gone). */
static enum ls_err close_books(struct ls_take *take, enum ls_err ran, enum ls_take_state *state,
                               char *first_missing, size_t room, struct ls_diag *diag)
{
    struct ls_takedir *dir = NULL;
    size_t n_missing = 0;
    enum ls_err err = ls_store_flush(take->store, diag);
    if (!err)
        err = ls_takedir_open(ls_store_folder(take->store), &dir, diag);
    if (err)
        return err;
    LS_CLEANUP_FREE char *take_json = NULL;
    char **missing = list_missing(take, dir, &n_missing);
    *state = end_state(ran, n_missing);
    snprintf(first_missing, room, "%zu of them, first %s", n_missing, n_missing ? missing[0] : "-");
    err = missing ? put_findings(take, dir->take_json, *state == LS_TAKE_COMPLETE, &take_json, diag)
                  : LS_ERR_NOMEM;
    const struct ls_store_end end = {.state = store_state(*state),
                                     .take_json = take_json,
                                     .missing = (const char *const *)missing,
                                     .n_missing = n_missing};
    if (!err)
        err = ls_store_set_state(take->store, &end, diag);
    for (size_t i = 0; i < n_missing; i++)
        free(missing[i]);
    free(missing);
    ls_takedir_close(dir);
    return err;
}

/* *written: the take's folder says how it ended. */
static enum ls_take_state run(struct ls_take *take, struct ls_capture_report *report,
                              struct ls_diag *message, bool *written)
{
    struct ls_diag why = {0}, books = {0};
    enum ls_take_state state = LS_TAKE_FAILED;
    char missing[128] = "";
    *report = (struct ls_capture_report){0};
    enum ls_err err = ls_capture_run(take->capture, report, &why);
    enum ls_err closed = close_books(take, err, &state, missing, sizeof missing, &books);
    if (!closed)
        closed = ls_store_close(take->store, &books);
    else
        ls_store_close(take->store, NULL);
    take->store = NULL;
    *written = !closed;
    ls_rig_close(&take->rig); /* one that is gone takes seconds: not the main loop's */
    if (closed && !err) {
        ls_fail(message, closed, "the take could not be written: %.400s", books.text);
        return LS_TAKE_FAILED;
    }
    if (err && closed)
        ls_fail(message, err, "%.250s; and the take could not be written: %.200s", why.text,
                books.text);
    else if (err)
        ls_fail(message, err, "%s", why.text);
    else if (state == LS_TAKE_INCOMPLETE)
        ls_fail(message, LS_OK, "conditions missing after every repair: %s; resume to try again",
                missing);
    else
        ls_fail(message, LS_OK, "%s%s%s", report->repaired[0] ? "complete; repaired: " : "complete",
                report->repaired, take->said);
    return state;
}

enum ls_take_state ls_take_run(struct ls_take *take, struct ls_capture_report *report,
                               struct ls_diag *message)
{
    char id[128];
    bool written = true;
    snprintf(id, sizeof id, "%s", ls_take_id(take));
    enum ls_take_state state = run(take, report, message, &written);
    if (!written)
        ls_events_alarm(take->context->events, LS_ALARM_DISK, true, id, message->text);
    else if (state == LS_TAKE_FAILED || state == LS_TAKE_INCOMPLETE)
        ls_events_alarm(take->context->events, LS_ALARM_FAULT, true, id, message->text);
    return state;
}

void ls_take_abort(struct ls_take *take)
{
    ls_capture_abort(take->capture);
}

void ls_take_blank(struct ls_take *take)
{
    ls_capture_blank(take->capture);
}

void ls_take_progress(const struct ls_take *take, struct ls_capture_progress *out)
{
    ls_capture_progress(take->capture, out);
}

void ls_take_destroy(struct ls_take *take)
{
    if (!take)
        return;
    ls_capture_destroy(take->capture);
    ls_checks_destroy(take->checks);
    json_decref(take->led_record);
    ls_store_close(take->store, NULL);
    ls_rig_close(&take->rig);
    if (take->darks)
        for (size_t i = 0; i < (size_t)take->context->config->n_cameras * take->plan->n_exposures;
             i++)
            free(take->darks[i]);
    for (uint32_t i = 0; i < LS_MAX_CAMERAS; i++)
        ls_pixel_list_finish(&take->defects[i]);
    free(take->darks);
    free(take->done);
    ls_plan_destroy(take->plan);
    free(take);
}
