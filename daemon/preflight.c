#include "daemon/preflight.h"

#include "core/exr.h"
#include "core/multiplex.h"
#include "daemon/bracket.h"
#include "daemon/exposure_fit.h"
#include "daemon/flashing.h"
#include "daemon/led_record.h"
#include "daemon/plan_load.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    TICKET_BYTES = 768, /* of journal per shot and attempt, at most */
    PUBLISHED_BYTES_PER_TILE = 40,
    PUBLISHED_BYTES = 512,
    DOCUMENT_BYTES = 8 << 20, /* take.json, twice */
    MAX_PATTERN_WARNINGS = 8,
    HOLD_MARGIN_US = 100000, /* from lit to exposing and from exposed to received, host included */
};

static void warn(struct ls_preflight *out, const char *fmt, ...) LS_PRINTF(2, 3);
static void warn(struct ls_preflight *out, const char *fmt, ...)
{
    size_t used = strlen(out->warnings);
    va_list args;
    va_start(args, fmt);
    vsnprintf(out->warnings + used, sizeof out->warnings - used, fmt, args);
    va_end(args);
    used = strlen(out->warnings);
    snprintf(out->warnings + used, sizeof out->warnings - used, "\n");
}

static enum ls_err check_rig(const struct ls_preflight_input *in, struct ls_diag *diag)
{
    const struct ls_config *c = in->config;
    if (in->lights->n_channels < c->n_channels)
        return ls_fail(diag, LS_ERR_INVALID,
                       "the rig file has %u channels, the controller %u: correct the rig file",
                       c->n_channels, in->lights->n_channels);
    for (uint32_t i = 0; i < c->n_lights; i++)
        if (c->lights[i].address >= in->lights->n_lights)
            return ls_fail(diag, LS_ERR_INVALID,
                           "light %u has address %u, the controller has addresses 0 to %u: "
                           "correct the positions file",
                           i, c->lights[i].address, in->lights->n_lights - 1);
    return LS_OK;
}

/* What keeps the dome dark at this moment. */
static enum ls_err check_dome(const struct ls_preflight_input *in, struct ls_diag *diag)
{
    const struct ls_lights_status *s = in->status;
    if (s && s->interlock_open)
        return ls_fail(diag, LS_ERR_REFUSED, "the light controller's interlock is open: close it");
    if (s && s->estop_pressed)
        return ls_fail(diag, LS_ERR_REFUSED,
                       "the light controller's emergency stop is pressed: release it");
    if (s && s->hot)
        return ls_fail(diag, LS_ERR_REFUSED,
                       "the dome is at %d C, %d over the %u C from which the controller calls it "
                       "hot: let it cool",
                       s->temperature_c, s->temperature_c - (int32_t)in->lights->hot_c,
                       in->lights->hot_c);
    return ls_lights_test_work(in->lights, in->config->work_channel, in->config->work_level, diag);
}

/* In the order they are fired. */
static uint32_t fill_steps(const struct ls_plan *p, struct ls_step *steps)
{
    uint32_t n = 0;
    for (uint32_t round = 0; round < ls_bracket_rounds(p); round++)
        for (uint32_t i = 0; i < p->n_steps; i++)
            if (ls_bracket_in_round(p, round, i))
                steps[n++] = (struct ls_step){.condition = p->steps[i].condition,
                                              .pulse_us = p->pulse_us[p->steps[i].exposure],
                                              .settle_us = p->settle_us};
    return n;
}

static enum ls_err check_program(const struct ls_preflight_input *in, struct ls_diag *diag)
{
    const struct ls_plan *p = in->plan;
    struct ls_condition *conditions = calloc(p->n_conditions, sizeof *conditions);
    struct ls_step *steps = calloc(p->n_steps, sizeof *steps);
    enum ls_err err = LS_ERR_NOMEM;
    if (conditions && steps) {
        for (uint32_t i = 0; i < p->n_conditions; i++)
            conditions[i] = p->conditions[i].lights;
        const struct ls_program program = {conditions, p->n_conditions, steps, fill_steps(p, steps),
                                           p->period_us};
        err = ls_lights_test(in->lights, &program, diag);
    }
    free(conditions);
    free(steps);
    return err;
}

static enum ls_err check_bracket(const struct ls_preflight_input *in, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    for (uint32_t k = 0; k < in->config->n_cameras && !err; k++) {
        const struct ls_config_camera *c = &in->config->cameras[k];
        bool width = c->driver.exposure == LS_EXPOSURE_WIDTH;
        err = ls_bracket_check(in->plan, in->config, k, width ? c->exposure_offset_us : 0, diag);
    }
    return err;
}

static enum ls_err check_offsets(const struct ls_preflight_input *in, struct ls_diag *diag)
{
    if (in->plan->subject != LS_SUBJECT_LIVE || in->plan->allow_flashing ||
        !ls_exposure_fit_needed(in->config))
        return LS_OK;
    return ls_fail(
        diag, LS_ERR_REFUSED,
        "the rig file does not say exposure_offset_us, and measuring it would flash at a "
        "live subject: a take of a still subject measures it, take.json says it");
}

/* A held light must outlast the trigger's way, the exposure and the way of the frame. */
static enum ls_err check_hold(const struct ls_preflight_input *in, struct ls_diag *diag)
{
    uint32_t longest = 0;
    for (uint32_t i = 0; i < in->plan->n_exposures; i++)
        longest = in->plan->pulse_us[i] > longest ? in->plan->pulse_us[i] : longest;
    for (uint32_t k = 0; k < in->config->n_cameras; k++)
        if (in->config->cameras[k].driver.trigger == LS_TRIGGER_SOFTWARE &&
            (uint64_t)longest + HOLD_MARGIN_US >= in->lights->max_hold_us)
            return ls_fail(diag, LS_ERR_LIMIT,
                           "exposures_us: camera %u is triggered by software, and %u us with %d us "
                           "for its trigger and frame do not fit the controller's longest hold of "
                           "%u us: use shorter exposures",
                           k, longest, HOLD_MARGIN_US, in->lights->max_hold_us);
    return LS_OK;
}

/* Is a camera driven one step at a time? As capture_devices.c has it. */
static bool is_stepwise(const struct ls_preflight_input *in)
{
    for (uint32_t k = 0; k < in->config->n_cameras; k++) {
        const struct ls_camera_config *c = &in->config->cameras[k].driver;
        if (!in->cameras[k]->tick_hz || c->trigger == LS_TRIGGER_SOFTWARE)
            return true;
    }
    return false;
}

/* What all cameras send for a step has to pass the link they share before the next one's. */
static enum ls_err check_link(const struct ls_preflight_input *in, struct ls_diag *diag)
{
    enum { HEADERS_BYTES = 36, FRAMING_BYTES = 14 + 24 }; /* of IP, UDP, GVSP; of Ethernet */
    double bytes = 0;
    for (uint32_t k = 0; k < in->config->n_cameras; k++) {
        double packet = in->config->cameras[k].driver.packet_size;
        bytes += (double)in->cameras[k]->payload_bytes * (packet + FRAMING_BYTES) /
                 (packet - HEADERS_BYTES);
    }
    double us = in->config->link_mbit_s > 0 ? bytes * 8 / in->config->link_mbit_s : 0;
    if (us <= in->plan->period_us)
        return LS_OK;
    return ls_fail(diag, LS_ERR_LIMIT,
                   "%.2f MB of %u cameras take %.0f us on the link of %.0f Mbit/s that they share, "
                   "and the next step comes after %u us: say period_us = %.0f, read out a smaller "
                   "region, or give the cameras links of their own",
                   bytes * 1e-6, in->config->n_cameras, us, in->config->link_mbit_s,
                   in->plan->period_us, ceil(us));
}

static bool is_done(const struct ls_preflight_input *in, uint32_t condition)
{
    return in->condition_done && in->condition_done[condition];
}

uint64_t ls_preflight_bytes(const struct ls_preflight_input *in)
{
    const struct ls_plan *p = in->plan;
    uint64_t bytes = DOCUMENT_BYTES;
    for (uint32_t k = 0; k < in->config->n_cameras; k++) {
        const struct ls_camera_info *c = in->cameras[k];
        uint64_t tiles = (uint64_t)((c->width + 63) / 64) * ((c->height + 63) / 64);
        uint64_t shot = (uint64_t)TICKET_BYTES * (1 + in->config->retries);
        if (p->keep_raw)
            shot += (c->payload_bytes + 4095) & ~(size_t)4095;
        for (uint32_t i = 0; i < p->n_conditions; i++)
            if (!is_done(in, i))
                bytes +=
                    ls_exr_mosaic_bytes_max(c->width, c->height,
                                            p->conditions[i].dark ? LS_EXR_FLOAT : LS_EXR_HALF) +
                    PUBLISHED_BYTES + tiles * PUBLISHED_BYTES_PER_TILE +
                    shot * p->conditions[i].n_steps;
    }
    return bytes;
}

static double seconds(const struct ls_plan *p)
{
    double us = 0;
    for (uint32_t i = 0; i < p->n_steps; i++) {
        double step = (double)p->pulse_us[p->steps[i].exposure] + p->settle_us;
        us += step > p->period_us ? step : p->period_us;
    }
    return (us + (double)ls_bracket_settling(p) * p->period_us) * 1e-6;
}

/* After check_rig and check_program: addresses exist. */
static enum ls_err weigh(const struct ls_preflight_input *in, struct ls_preflight *out,
                         struct ls_diag *diag)
{
    struct ls_plan_load load;
    enum ls_err err = ls_plan_load(in->plan, in->lights, &load, diag);
    out->energy_j = load.energy_j;
    out->peak_current_a = load.peak_current_a;
    out->led_duty = out->seconds > 0 ? load.busiest_s / out->seconds : 0;
    return err;
}

static void warn_of_darks(const struct ls_preflight_input *in, struct ls_preflight *out)
{
    uint32_t darks = 0, single = 0;
    for (uint32_t i = 0; i < in->plan->n_conditions; i++) {
        if (in->plan->conditions[i].dark && !in->plan->conditions[i].watch)
            darks = in->plan->conditions[i].repeats;
        single += in->plan->conditions[i].light >= 0;
    }
    if (!darks || !single)
        return;
    /* the dark's error is common to all lights: N^2 sigma^2 / K against N sigma^2 of the frames */
    double ratio = (double)single / darks;
    out->dark_noise_share = ratio / (1 + ratio);
    if (out->dark_noise_share > 0.9)
        warn(out,
             "darks: with %u of them %.0f %% of a relit picture's noise power comes from the "
             "darks; %u would halve it",
             darks, 100 * out->dark_noise_share, single);
}

/* Is there an earlier picture of the same pattern, channel and level? Pictures of an entry stand
 * together, so the one before says it. */
static bool is_repeated(const struct ls_plan *plan, uint32_t i)
{
    const struct ls_plan_condition *c = &plan->conditions[i];
    const struct ls_plan_condition *before = i ? c - 1 : c;
    while ((before->watch || before->reference) && before > plan->conditions)
        before--;
    return before != c && before->channel == c->channel && before->level == c->level &&
           !strcmp(before->pattern, c->pattern);
}

static void warn_of_calibration(const struct ls_preflight_input *in, struct ls_preflight *out)
{
    if (!in->calibration) {
        warn(out, "no calibration: the take can be photographed and stored, not promoted or relit");
        return;
    }
    uint32_t n = 0;
    for (uint32_t i = 0; i < in->plan->n_conditions; i++) {
        const struct ls_plan_condition *c = &in->plan->conditions[i];
        if (ls_plan_factor(c, in->config, in->calibration) > 0 || is_repeated(in->plan, i))
            continue;
        if (n++ < MAX_PATTERN_WARNINGS)
            warn(out,
                 "%s in %s at duty %.5f (%s ...) is not calibrated: the take will be marked "
                 "uncalibrated",
                 c->pattern, in->config->channels[c->channel].name, c->level / 65535.0, c->id);
    }
    if (n > MAX_PATTERN_WARNINGS)
        warn(out, "%u more patterns are not calibrated", n - MAX_PATTERN_WARNINGS);
}

static void judge_multiplexing(const struct ls_preflight_input *in, uint32_t camera,
                               const struct ls_plan_condition *c, struct ls_preflight *out)
{
    const struct ls_config_camera *cam = &in->config->cameras[camera];
    double factor = in->calibration ? ls_plan_factor(c, in->config, in->calibration) : 1;
    double scale = (factor > 0 ? factor : 1) / (c->level / 65535.0);
    double read = (double)cam->read_noise_dn * (double)cam->read_noise_dn + 1.0 / 12;
    double half = (double)cam->full_scale_dn / 2, shot = 1 / (double)cam->electrons_per_dn;
    const char *name = in->config->channels[c->channel].name;
    struct ls_multiplex_noise black, bright;
    if (ls_multiplex_noise(c->parts, in->config->n_lights, scale, 0, read, shot, &black, NULL) ||
        ls_multiplex_noise(c->parts, in->config->n_lights, scale, half, read, shot, &bright, NULL))
        return;
    if (black.gain <= 1)
        warn(
            out,
            "multiplex of %s, camera %u: never wins over each (gain %.2f at black, %.2f at half of "
            "full scale): at this level the rows are too dim",
            name, camera, black.gain, bright.gain);
    else
        warn(out,
             "multiplex of %s, camera %u: wins where a light alone reads less than %.3g DN, loses "
             "above (gain %.2f at black, %.2f at half of full scale)",
             name, camera, black.break_even, black.gain, bright.gain);
}

/* What many lights at a time gain and lose, of the same exposures: core/multiplex.h. */
static void warn_of_multiplexing(const struct ls_preflight_input *in, struct ls_preflight *out)
{
    for (uint32_t i = 0; i < in->plan->n_conditions; i++) {
        const struct ls_plan_condition *c = &in->plan->conditions[i];
        if (strcmp(c->pattern, "multiplex") || c->part > 0)
            continue;
        for (uint32_t k = 0; k < in->config->n_cameras; k++)
            judge_multiplexing(in, k, c, out);
    }
}

static void warn_of_bracket(const struct ls_preflight_input *in, struct ls_preflight *out)
{
    if (in->plan->bracket == LS_BRACKET_OUTERMOST && in->plan->subject == LS_SUBJECT_LIVE &&
        in->plan->n_exposures > 1)
        warn(out, "the exposures of a condition are a whole round apart, in which a live subject "
                  "moves: one exposure is safer");
}

static void warn_of_cameras(const struct ls_preflight_input *in, struct ls_preflight *out)
{
    for (uint32_t k = 0; k < in->config->n_cameras; k++) {
        if (in->cameras[k]->unverified[0])
            warn(out, "camera %u cannot set or prove: %.300s", k, in->cameras[k]->unverified);
        if (!in->cameras[k]->packet_socket)
            warn(out,
                 "camera %u is received over UDP: without CAP_NET_RAW a busy machine loses "
                 "more packets",
                 k);
    }
}

static void warn_of_leds(const struct ls_preflight_input *in, struct ls_preflight *out)
{
    char text[512];
    ls_led_record_say(in->led_record, text, sizeof text);
    if (text[0])
        warn(out, "%s", text);
}

enum ls_err ls_preflight_check(const struct ls_preflight_input *in, struct ls_preflight *out,
                               struct ls_diag *diag)
{
    *out = (struct ls_preflight){.bracket = ls_bracket_name(in->plan->bracket),
                                 .conditions = in->plan->n_conditions,
                                 .steps = in->plan->n_steps,
                                 .shots = in->plan->n_steps * in->config->n_cameras,
                                 .seconds = seconds(in->plan),
                                 .bytes = ls_preflight_bytes(in),
                                 .disk_free_bytes = in->disk_free_bytes};
    enum ls_err err = check_rig(in, diag);
    if (!err)
        err = check_dome(in, diag);
    if (!err)
        err = check_program(in, diag);
    if (!err)
        err = check_link(in, diag);
    if (!err)
        err = check_bracket(in, diag);
    if (!err)
        err = check_hold(in, diag);
    if (!err)
        err = ls_flashing_check(in->plan, in->config, in->lights, is_stepwise(in), diag);
    if (!err)
        err = check_offsets(in, diag);
    if (!err)
        err = weigh(in, out, diag);
    if (err)
        return err;
    warn_of_leds(in, out);
    warn_of_darks(in, out);
    warn_of_calibration(in, out);
    warn_of_multiplexing(in, out);
    warn_of_bracket(in, out);
    warn_of_cameras(in, out);
    if (out->bytes + in->config->reserve_bytes > in->disk_free_bytes)
        return ls_fail(diag, LS_ERR_FULL,
                       "the take needs %.1f MB and %.1f MB stay reserved, but only %.1f MB are "
                       "free in %s: make room or choose another storage folder",
                       (double)out->bytes / 1e6, (double)in->config->reserve_bytes / 1e6,
                       (double)in->disk_free_bytes / 1e6, in->config->storage);
    return LS_OK;
}
