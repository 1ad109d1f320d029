#include "drivers/aravis/settings.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

/** One pass over a camera's settings. */
struct pass {
    ArvCamera *camera;
    ArvDevice *device;
    const char *address;
    struct ls_camera_info *info;
    struct ls_diag *diag;
};

uint64_t ls_aravis_host_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC_RAW, &now);
    return (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
}

enum ls_err ls_aravis_fail(struct ls_diag *diag, const char *address, const char *what,
                           GError *error)
{
    bool gone = g_error_matches(error, ARV_DEVICE_ERROR, ARV_DEVICE_ERROR_TIMEOUT) ||
                g_error_matches(error, ARV_DEVICE_ERROR, ARV_DEVICE_ERROR_NOT_CONNECTED) ||
                g_error_matches(error, ARV_DEVICE_ERROR, ARV_DEVICE_ERROR_NOT_CONTROLLER) ||
                g_error_matches(error, ARV_DEVICE_ERROR, ARV_DEVICE_ERROR_TRANSFER_ERROR);
    enum ls_err err = gone ? LS_ERR_GONE : LS_ERR_REFUSED;
    err = ls_fail(diag, err, "camera %s: %s: %s", address, what, error->message);
    g_error_free(error);
    return err;
}

static bool available(struct pass *p, const char *feature)
{
    return arv_device_is_feature_available(p->device, feature, NULL);
}

static void note_unverified(struct pass *p, const char *feature)
{
    char *list = p->info->unverified;
    size_t used = strlen(list), room = sizeof p->info->unverified - used;
    snprintf(list + used, room, "%s%s", used ? ", " : "", feature);
}

static enum ls_err mismatch(struct pass *p, const char *feature, const char *asked, const char *got,
                            const GError *why)
{
    return ls_fail(p->diag, LS_ERR_MISMATCH, "camera %s: %s: asked for %s, got %s%s%s%s",
                   p->address, feature, asked, got, why ? " (" : "", why ? why->message : "",
                   why ? ")" : "");
}

static bool is_gone(const GError *error)
{
    return error && error->domain == ARV_DEVICE_ERROR && error->code == ARV_DEVICE_ERROR_TIMEOUT;
}

/** Forward a lost camera, else judge by what reads back; frees @written and @read. */
static enum ls_err settle(struct pass *p, const char *feature, bool same, const char *asked,
                          const char *got, GError *written, GError *read)
{
    enum ls_err err = LS_OK;
    if (is_gone(written))
        err = ls_aravis_fail(p->diag, p->address, feature, g_steal_pointer(&written));
    else if (read)
        err = ls_aravis_fail(p->diag, p->address, feature, g_steal_pointer(&read));
    else if (!same)
        err = mismatch(p, feature, asked, got, written);
    g_clear_error(&written);
    g_clear_error(&read);
    return err;
}

static enum ls_err set_text(struct pass *p, const char *feature, const char *asked)
{
    GError *written = NULL, *read = NULL;
    const char *got = arv_device_get_string_feature_value(p->device, feature, &read);
    if (read || g_strcmp0(got, asked) != 0) {
        g_clear_error(&read);
        arv_device_set_string_feature_value(p->device, feature, asked, &written);
        got = arv_device_get_string_feature_value(p->device, feature, &read);
    }
    return settle(p, feature, g_strcmp0(got, asked) == 0, asked, got ? got : "nothing", written,
                  read);
}

static enum ls_err set_integer(struct pass *p, const char *feature, int64_t asked)
{
    GError *written = NULL, *read = NULL;
    char asked_text[32], got_text[32];
    int64_t got = arv_device_get_integer_feature_value(p->device, feature, &read);
    if (read || got != asked) {
        g_clear_error(&read);
        arv_device_set_integer_feature_value(p->device, feature, asked, &written);
        got = arv_device_get_integer_feature_value(p->device, feature, &read);
    }
    snprintf(asked_text, sizeof asked_text, "%" G_GINT64_FORMAT, asked);
    snprintf(got_text, sizeof got_text, "%" G_GINT64_FORMAT, got);
    return settle(p, feature, got == asked, asked_text, got_text, written, read);
}

static enum ls_err set_boolean(struct pass *p, const char *feature, bool asked)
{
    GError *written = NULL, *read = NULL;
    bool got = arv_device_get_boolean_feature_value(p->device, feature, &read);
    if (read || got != asked) {
        g_clear_error(&read);
        arv_device_set_boolean_feature_value(p->device, feature, asked, &written);
        got = arv_device_get_boolean_feature_value(p->device, feature, &read);
    }
    return settle(p, feature, got == asked, asked ? "on" : "off", got ? "on" : "off", written,
                  read);
}

/** A number Aravis knows under several vendors' names. */
struct number {
    const char *name;
    gboolean (*available)(ArvCamera *camera, GError **error);
    void (*set)(ArvCamera *camera, double value, GError **error);
    double (*get)(ArvCamera *camera, GError **error);
};

static const struct number exposure_time = {"ExposureTime", arv_camera_is_exposure_time_available,
                                            arv_camera_set_exposure_time,
                                            arv_camera_get_exposure_time};
static const struct number gain = {"Gain", arv_camera_is_gain_available, arv_camera_set_gain,
                                   arv_camera_get_gain};
static const struct number black_level = {"BlackLevel", arv_camera_is_black_level_available,
                                          arv_camera_set_black_level, arv_camera_get_black_level};

static enum ls_err settle_number(struct pass *p, const char *feature, double asked, double got,
                                 GError *written, GError *read)
{
    char asked_text[32], got_text[32];
    snprintf(asked_text, sizeof asked_text, "%g", asked);
    snprintf(got_text, sizeof got_text, "%g", got);
    bool same = fabs(got - asked) <= 0.01 * fabs(asked) + 0.05;
    return settle(p, feature, same, asked_text, got_text, written, read);
}

static enum ls_err set_number(struct pass *p, const struct number *number, double asked,
                              double *got)
{
    GError *written = NULL, *read = NULL;
    if (!number->available(p->camera, NULL)) {
        note_unverified(p, number->name);
        return LS_OK;
    }
    number->set(p->camera, asked, &written);
    *got = number->get(p->camera, &read);
    return settle_number(p, number->name, asked, *got, written, read);
}

static enum ls_err set_gamma(struct pass *p)
{
    GError *written = NULL, *read = NULL;
    arv_device_set_float_feature_value(p->device, "Gamma", 1, &written);
    double got = arv_device_get_float_feature_value(p->device, "Gamma", &read);
    return settle_number(p, "Gamma", 1, got, written, read);
}

static enum ls_err refuse_rolling(struct pass *p)
{
    if (!available(p, "SensorShutterMode")) {
        note_unverified(p, "SensorShutterMode");
        return LS_OK;
    }
    GError *error = NULL;
    const char *mode = arv_device_get_string_feature_value(p->device, "SensorShutterMode", &error);
    if (error)
        return ls_aravis_fail(p->diag, p->address, "SensorShutterMode", error);
    if (strcmp(mode, "Global") == 0)
        return LS_OK;
    return ls_fail(p->diag, LS_ERR_UNSUPPORTED,
                   "camera %s: SensorShutterMode is %s: only global shutters see the whole "
                   "picture under one light",
                   p->address, mode);
}

static enum ls_err set_linear(struct pass *p)
{
    static const char *const autos[] = {"ExposureAuto", "GainAuto", "BlackLevelAuto",
                                        "BalanceWhiteAuto"};
    static const char *const curves[] = {"GammaEnable", "LUTEnable"};
    enum ls_err err = LS_OK;
    for (size_t i = 0; !err && i < sizeof autos / sizeof *autos; i++) {
        if (available(p, autos[i]))
            err = set_text(p, autos[i], "Off");
        else if (strcmp(autos[i], "BlackLevelAuto") != 0)
            note_unverified(p, autos[i]);
    }
    for (size_t i = 0; !err && i < sizeof curves / sizeof *curves; i++)
        if (available(p, curves[i]))
            err = set_boolean(p, curves[i], false);
    if (!err && available(p, "Gamma"))
        err = set_gamma(p);
    else if (!err && !available(p, "GammaEnable"))
        note_unverified(p, "Gamma");
    if (!err && !available(p, "LUTEnable"))
        note_unverified(p, "LUTEnable");
    return err;
}

/** Offsets to zero first, so that any size fits. */
static enum ls_err set_region(struct pass *p, const struct ls_camera_config *config)
{
    bool whole = config->width == 0;
    const struct {
        const char *feature;
        uint32_t value;
        bool optional;
    } order[] = {
        {"OffsetX", 0, true},
        {"OffsetY", 0, true},
        {"Width", whole ? p->info->sensor_width : config->width, false},
        {"Height", whole ? p->info->sensor_height : config->height, false},
        {"OffsetX", config->offset_x, true},
        {"OffsetY", config->offset_y, true},
    };
    enum ls_err err = LS_OK;
    for (size_t i = 0; !err && i < sizeof order / sizeof *order; i++) {
        if (order[i].optional && order[i].value == 0 && !available(p, order[i].feature))
            continue;
        err = set_integer(p, order[i].feature, order[i].value);
    }
    return err;
}

static enum ls_err check_black_level(struct pass *p)
{
    GError *error = NULL;
    if (!black_level.available(p->camera, NULL)) {
        note_unverified(p, black_level.name);
        return LS_OK;
    }
    p->info->black_level = black_level.get(p->camera, &error);
    if (error)
        return ls_aravis_fail(p->diag, p->address, black_level.name, error);
    if (p->info->black_level > 0)
        return LS_OK;
    return mismatch(p, black_level.name, "a value above 0, or noise below black is cut off", "0",
                    NULL);
}

static enum ls_err set_analog(struct pass *p, const struct ls_camera_config *config)
{
    enum ls_err err = set_number(p, &gain, config->gain, &p->info->gain);
    if (err)
        return err;
    if (config->black_level > 0)
        return set_number(p, &black_level, config->black_level, &p->info->black_level);
    return check_black_level(p);
}

static bool offers_width(struct pass *p)
{
    return available(p, "ExposureMode") && arv_device_is_enumeration_entry_available(
                                               p->device, "ExposureMode", "TriggerWidth", NULL);
}

static enum ls_camera_exposure choose_exposure(struct pass *p,
                                               const struct ls_camera_config *config)
{
    if (config->exposure != LS_EXPOSURE_AUTO)
        return config->exposure;
    return config->trigger == LS_TRIGGER_LINE && offers_width(p) ? LS_EXPOSURE_WIDTH
                                                                 : LS_EXPOSURE_TIMED;
}

static enum ls_err set_exposure_mode(struct pass *p, const struct ls_camera_config *config)
{
    bool width = config->exposure == LS_EXPOSURE_WIDTH;
    if (width && available(p, "ExposureMode") && !offers_width(p))
        return ls_fail(p->diag, LS_ERR_UNSUPPORTED,
                       "camera %s: its ExposureMode offers no TriggerWidth: use timed exposure",
                       p->address);
    if (available(p, "ExposureMode"))
        return set_text(p, "ExposureMode", width ? "TriggerWidth" : "Timed");
    if (width)
        return ls_fail(p->diag, LS_ERR_UNSUPPORTED,
                       "camera %s: has no ExposureMode: use timed exposure", p->address);
    note_unverified(p, "ExposureMode");
    return LS_OK;
}

static enum ls_err expect_text(struct pass *p, const char *feature, const char *asked)
{
    GError *error = NULL;
    if (!available(p, feature)) {
        note_unverified(p, feature);
        return LS_OK;
    }
    const char *got = arv_device_get_string_feature_value(p->device, feature, &error);
    return settle(p, feature, g_strcmp0(got, asked) == 0, asked, got ? got : "nothing", NULL,
                  error);
}

/** arv_camera_set_trigger resets the others and the activation: mode and activation come after. */
static enum ls_err set_trigger(struct pass *p, const struct ls_camera_config *config)
{
    const char *source = config->trigger == LS_TRIGGER_LINE ? "Line0" : "Software";
    GError *error = NULL;
    if (available(p, "AcquisitionFrameRateEnable"))
        arv_device_set_boolean_feature_value(p->device, "AcquisitionFrameRateEnable", FALSE,
                                             &error);
    g_clear_error(&error); /* without it the camera may only be slower, which shows as misses */
    arv_camera_set_trigger(p->camera, source, &error);
    if (error)
        return ls_aravis_fail(p->diag, p->address, "trigger", error);
    enum ls_err err = set_exposure_mode(p, config);
    if (!err && available(p, "TriggerActivation"))
        err = set_text(p, "TriggerActivation", "RisingEdge");
    if (!err)
        err = expect_text(p, "TriggerSelector", "FrameStart");
    if (!err)
        err = expect_text(p, "TriggerMode", "On");
    if (!err)
        err = expect_text(p, "TriggerSource", source);
    if (!err)
        err = expect_text(p, "TriggerActivation", "RisingEdge");
    if (!err && config->exposure == LS_EXPOSURE_TIMED)
        err = set_number(p, &exposure_time, config->exposure_us, &p->info->exposure_us);
    return err;
}

static bool enable_chunk(struct pass *p, const char *selector, const char *feature,
                         struct ls_aravis_chunk *chunk)
{
    GError *error = NULL;
    if (!arv_device_is_enumeration_entry_available(p->device, "ChunkSelector", selector, NULL))
        return false;
    arv_camera_set_chunk_state(p->camera, selector, TRUE, &error);
    bool on = !error && arv_camera_get_chunk_state(p->camera, selector, NULL);
    g_clear_error(&error);
    if (on)
        ls_aravis_chunk_resolve(p->device, feature, chunk);
    return on && chunk->found;
}

/** A counter is only worth reading if it is known to count the trigger line. */
static bool counts_line(struct pass *p)
{
    return !available(p, "CounterEventSource") ||
           set_text(p, "CounterEventSource", "Line0") == LS_OK;
}

static enum ls_err set_chunks(struct pass *p, const struct ls_camera_config *config,
                              struct ls_aravis_setup *setup)
{
    struct ls_camera_info *info = p->info;
    enum ls_err err;
    if (!available(p, "ChunkModeActive")) {
        if (config->chunks)
            note_unverified(p, "ChunkModeActive");
        return LS_OK;
    }
    err = set_boolean(p, "ChunkModeActive", config->chunks);
    if (err || !config->chunks)
        return err;
    info->has_chunks = true;
    info->has_chunk_exposure =
        enable_chunk(p, "ExposureTime", "ChunkExposureTime", &setup->exposure);
    if (!info->has_chunk_exposure)
        note_unverified(p, "ChunkExposureTime");
    if (config->trigger != LS_TRIGGER_LINE)
        return LS_OK;
    info->has_trigger_counter =
        (enable_chunk(p, "CounterValue", "ChunkCounterValue", &setup->counter) && counts_line(p)) ||
        enable_chunk(p, "Triggerinputcounter", "ChunkTriggerinputcounter", &setup->counter);
    if (!info->has_trigger_counter)
        note_unverified(p, "ChunkCounterValue");
    return LS_OK;
}

static enum ls_err set_stream(struct pass *p, const struct ls_camera_config *config,
                              struct ls_aravis_setup *setup)
{
    GError *error = NULL;
    enum ls_err err = set_integer(p, "GevSCPSPacketSize", config->packet_size);
    if (err)
        return err;
    arv_camera_gv_set_packet_size_adjustment(p->camera, ARV_GV_PACKET_SIZE_ADJUSTMENT_NEVER);
    if (config->packet_delay_ns || available(p, "GevSCPD")) { /* in ticks of the camera's clock */
        double ticks = config->packet_delay_ns * 1e-9 * (double)p->info->tick_hz;
        err = set_integer(p, "GevSCPD", (int64_t)ceil(ticks));
    }
    if (err)
        return err;
    p->info->payload_bytes = arv_camera_get_payload(p->camera, &error);
    if (error)
        return ls_aravis_fail(p->diag, p->address, "PayloadSize", error);
    uint64_t bits = (uint64_t)setup->width * setup->height *
                    ARV_PIXEL_FORMAT_BIT_PER_PIXEL(setup->pixel_format);
    setup->image_bytes = (uint32_t)((bits + 7) / 8);
    if (p->info->payload_bytes >= setup->image_bytes)
        return LS_OK;
    return ls_fail(p->diag, LS_ERR_MISMATCH,
                   "camera %s: PayloadSize is %zu bytes: %u x %u %s needs %u", p->address,
                   p->info->payload_bytes, setup->width, setup->height, p->info->pixel_format,
                   setup->image_bytes);
}

static enum ls_err read_format(struct pass *p, struct ls_aravis_setup *setup)
{
    GError *error = NULL;
    int x, y, width, height;
    arv_camera_get_region(p->camera, &x, &y, &width, &height, &error);
    if (!error)
        setup->pixel_format = arv_camera_get_pixel_format(p->camera, &error);
    if (error)
        return ls_aravis_fail(p->diag, p->address, "region and format", error);
    p->info->width = setup->width = (uint32_t)width;
    p->info->height = setup->height = (uint32_t)height;
    return LS_OK;
}

static enum ls_err set_format(struct pass *p, const struct ls_camera_config *config,
                              struct ls_aravis_setup *setup)
{
    enum ls_err err = set_region(p, config);
    if (!err)
        err = set_text(p, "PixelFormat", config->pixel_format);
    if (err)
        return err;
    snprintf(p->info->pixel_format, sizeof p->info->pixel_format, "%s", config->pixel_format);
    return read_format(p, setup);
}

/** A latch that does not move is no latch. */
static void find_latch(struct pass *p, struct ls_aravis_setup *setup)
{
    struct ls_camera_control first = {0}, second = {0};
    setup->latch_command = setup->latch_value = NULL;
    if (available(p, "TimestampLatch") && available(p, "TimestampLatchValue")) {
        setup->latch_command = "TimestampLatch";
        setup->latch_value = "TimestampLatchValue";
        setup->latch_hz = 1000000000;
    } else if (available(p, "GevTimestampControlLatch") && available(p, "GevTimestampValue")) {
        setup->latch_command = "GevTimestampControlLatch";
        setup->latch_value = "GevTimestampValue";
        setup->latch_hz = p->info->tick_hz;
    }
    p->info->has_latch = setup->latch_command && setup->latch_hz &&
                         ls_aravis_latch(p->camera, p->address, setup, &first, NULL) == LS_OK &&
                         ls_aravis_latch(p->camera, p->address, setup, &second, NULL) == LS_OK &&
                         second.camera_ns > first.camera_ns;
    if (!p->info->has_latch)
        note_unverified(p, "TimestampLatch");
}

static void forget(struct ls_camera_info *info, struct ls_aravis_setup *setup)
{
    memset(setup, 0, sizeof *setup);
    info->has_chunks = info->has_chunk_exposure = info->has_trigger_counter = false;
    info->has_latch = info->has_trigger_width = info->realtime = false;
    info->exposure_us = info->gain = info->black_level = 0;
    info->unverified[0] = 0;
}

enum ls_err ls_aravis_apply(ArvCamera *camera, const char *address,
                            const struct ls_camera_config *given, struct ls_aravis_setup *setup,
                            struct ls_camera_info *info, struct ls_diag *diag)
{
    struct pass p = {camera, arv_camera_get_device(camera), address, info, diag};
    struct ls_camera_config chosen = *given;
    const struct ls_camera_config *config = &chosen;
    enum ls_err err;
    forget(info, setup);
    chosen.exposure = info->exposure = choose_exposure(&p, given);
    arv_camera_stop_acquisition(camera, NULL); /* left running by another host: may be refused */
    err = refuse_rolling(&p);
    if (!err)
        err = set_text(&p, "AcquisitionMode", "Continuous");
    if (!err)
        err = set_linear(&p);
    if (!err)
        err = set_format(&p, config, setup);
    if (!err)
        err = set_analog(&p, config);
    if (!err)
        err = set_trigger(&p, config);
    if (!err)
        err = set_chunks(&p, config, setup);
    if (!err)
        err = set_stream(&p, config, setup);
    if (err)
        return err;
    info->has_trigger_width = offers_width(&p);
    find_latch(&p, setup);
    return LS_OK;
}

enum ls_err ls_aravis_latch(ArvCamera *camera, const char *address,
                            const struct ls_aravis_setup *setup, struct ls_camera_control *control,
                            struct ls_diag *diag)
{
    ArvDevice *device = arv_camera_get_device(camera);
    GError *error = NULL;
    control->host_before_ns = ls_aravis_host_ns();
    arv_device_execute_command(device, setup->latch_command, &error);
    control->host_after_ns = ls_aravis_host_ns();
    uint64_t ticks = 0;
    if (!error)
        ticks = (uint64_t)arv_device_get_integer_feature_value(device, setup->latch_value, &error);
    if (error)
        return ls_aravis_fail(diag, address, setup->latch_command, error);
    uint64_t hz = setup->latch_hz;
    control->camera_ns = ticks / hz * 1000000000u + ticks % hz * 1000000000u / hz;
    return LS_OK;
}
