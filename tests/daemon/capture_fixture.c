#include "tests/daemon/capture_fixture.h"

#include "core/exr.h"
#include "tests/daemon/store_fixture.h"

#include <math.h>

static void make_config(struct stage *s)
{
    static char channel_name[] = "W", camera_names[][8] = {"front", "left"};
    s->config = (struct ls_config){.n_lights = N_LIGHTS,
                                   .lights = s->lights,
                                   .n_channels = 1,
                                   .n_cameras = s->options.n_cameras,
                                   .merge_threads = 2,
                                   .work_level = s->work_level,
                                   .ring_slots = 16,
                                   .retries = 3};
    s->config.channels[0].name = channel_name;
    for (int i = 0; i < N_LIGHTS; i++)
        s->lights[i].position_m[i % 3] = 1.35f;
    for (uint32_t i = 0; i < s->options.n_cameras; i++)
        s->config.cameras[i] = (struct ls_config_camera){
            .name = camera_names[i],
            .driver = {.trigger = s->options.software && !(s->options.mixed && i == 1)
                                      ? LS_TRIGGER_SOFTWARE
                                      : LS_TRIGGER_LINE,
                       .exposure = s->options.timed ? LS_EXPOSURE_TIMED : LS_EXPOSURE_WIDTH,
                       .frame_retention_us = 20000},
            .position_m = {0, 0, 2},
            .range_low = 0.10f,
            .range_high = 0.85f,
            .full_scale_dn = FAKE_FULL_SCALE,
            .electrons_per_dn = 1,
            .read_noise_dn = 1,
            .exposure_offset_us = FAKE_OFFSET_US,
            .black_check = true};
}

static void add_condition(struct stage *s, int light, uint8_t exposure, uint32_t n)
{
    uint32_t index = s->plan.n_conditions++;
    struct ls_plan_condition *c = &s->conditions[index];
    *c = (struct ls_plan_condition){.dark = light < 0,
                                    .exposure = exposure,
                                    .repeats = light < 0 ? (uint16_t)n : 1,
                                    .light = light,
                                    .channel = light < 0 ? -1 : 0,
                                    .first_step = s->plan.n_steps,
                                    .n_steps = n};
    g_snprintf(c->id, sizeof c->id, light < 0 ? "dark-%d" : "W-%04d", light < 0 ? exposure : light);
    s->ids[index] = c->id;
    if (light >= 0) {
        s->leds[light] = (struct ls_led){.light = (uint16_t)light, .level = 65535};
        c->lights =
            (struct ls_condition){.kind = LS_CONDITION_ONE, .n_leds = 1, .leds = &s->leds[light]};
    }
    for (uint32_t i = 0; i < n; i++)
        s->steps[s->plan.n_steps++] =
            (struct ls_plan_step){.condition = index,
                                  .repeat = light < 0 ? (uint16_t)i : 0,
                                  .exposure = light < 0 ? exposure : (uint8_t)i};
}

static void add_watch(struct stage *s, int index)
{
    struct ls_plan_condition *c = &s->conditions[s->plan.n_conditions];
    add_condition(s, -1, N_EXPOSURES - 1, WATCH_FRAMES);
    c->watch = true;
    g_snprintf(c->id, sizeof c->id, "watch-%d", index);
}

static void make_plan(struct stage *s)
{
    s->plan =
        (struct ls_plan){.subject = s->live ? LS_SUBJECT_LIVE : LS_SUBJECT_STILL,
                         .keep_raw = s->plan.keep_raw,
                         .bracket = s->options.timed ? LS_BRACKET_OUTERMOST : LS_BRACKET_WIDTH,
                         .period_us = PERIOD_US,
                         .n_exposures = N_EXPOSURES,
                         .pulse_us = {100, 500, 2000},
                         .conditions = s->conditions,
                         .steps = s->steps,
                         .leds = s->leds};
    for (uint8_t e = 0; e < N_EXPOSURES; e++)
        add_condition(s, -1, e, N_DARKS);
    for (int i = 0; i < s->n_lights; i++) {
        add_condition(s, i, 0, N_EXPOSURES);
        if (s->watches && (i + 1) % (N_LIGHTS / N_WATCHES) == 0)
            add_watch(s, (i + 1) / (N_LIGHTS / N_WATCHES) - 1);
    }
}

struct stage *new_stage(void)
{
    struct stage *s = g_new0(struct stage, 1);
    s->root = new_root();
    s->n_lights = N_LIGHTS;
    s->plan.keep_raw = true;
    s->options = (struct fake_options){.n_cameras = 1, .lose_light = -1};
    return s;
}

static void open_store(struct stage *s)
{
    const struct ls_store_config config = {.root = s->root,
                                           .name = "test",
                                           .take_json = "{}",
                                           .utc_s = 1715947200,
                                           .n_cameras = s->config.n_cameras,
                                           .n_shots = s->plan.n_steps * s->config.n_cameras,
                                           .conditions = s->ids,
                                           .n_conditions = s->plan.n_conditions,
                                           .keep_raw = s->plan.keep_raw,
                                           .need_bytes = 1 << 20,
                                           .shim = s->shim.before ? &s->shim : NULL};
    g_assert_cmpint(ls_store_create(&config, &s->store, &s->diag), ==, LS_OK);
    s->folder = g_strdup(ls_store_folder(s->store));
}

static void plug_in(struct stage *s)
{
    s->rig = fake_rig_new(&s->options);
    s->setup.lights = fake_rig_lights(s->rig);
    s->setup.cameras = fake_rig_cameras(s->rig);
}

void describe(struct stage *s)
{
    make_config(s);
    make_plan(s);
    s->setup = (struct ls_capture_setup){.config = &s->config,
                                         .plan = &s->plan,
                                         .metrics = &s->metrics,
                                         .reference_exposure_s = REFERENCE_S};
}

void prepare(struct stage *s)
{
    describe(s);
    open_store(s);
    s->setup.store = s->store;
    plug_in(s);
}

void set_up(struct stage *s)
{
    prepare(s);
    g_assert_cmpint(ls_capture_create(&s->setup, &s->capture, &s->diag), ==, LS_OK);
}

enum ls_err shoot(struct stage *s)
{
    set_up(s);
    enum ls_err err = ls_capture_run(s->capture, &s->report, &s->diag);
    g_test_message("%s: %s", ls_err_name(err), s->diag.text);
    g_assert_true(fake_rig_is_dark(s->rig));
    g_assert_cmpuint(fake_rig_underruns(s->rig), ==, 0);
    return err;
}

void clear(struct stage *s)
{
    ls_capture_destroy(s->capture);
    (void)ls_store_close(s->store, NULL);
    g_clear_pointer(&s->rig, fake_rig_free);
    remove_tree(s->root);
    g_free(s->root);
    g_free(s->folder);
    for (int i = 0; i < N_EXPOSURES; i++)
        free(s->darks[i]);
    g_free(s);
}

/* ---- what a take must satisfy ---- */

uint32_t count_mislabeled(struct stage *s, const struct ls_takedir *take)
{
    uint32_t wrong = 0;
    for (size_t i = 0; i < take->n_tickets; i++) {
        const struct ls_ticket *t = &take->tickets[i];
        char name[64];
        gchar *bytes;
        gsize n;
        g_snprintf(name, sizeof name, "cam%u/raw/%u-%u.raw", t->camera, t->shot, t->attempt);
        char *path = g_build_filename(s->folder, name, NULL);
        g_assert_true(g_file_get_contents(path, &bytes, &n, NULL));
        const uint16_t *px = (const uint16_t *)(const void *)bytes;
        g_assert_cmpuint(ls_crc32c(0, bytes, n), ==, t->raw_crc32c);
        int light = s->plan.conditions[t->condition].light;
        bool right = px[0] == light + 2 && s->plan.steps[t->step].condition == t->condition;
        right &= s->options.software || px[2] == s->plan.pulse_us[t->exposure] / 10 + 1;
        right &= fabs(t->chunk_exposure_us - t->exposure_used_us) < 0.02 * t->exposure_used_us;
        wrong += !right;
        g_free(bytes);
        g_free(path);
    }
    return wrong;
}

void check_picture(struct stage *s, const struct ls_takedir *take, uint32_t condition,
                   uint32_t camera)
{
    const struct ls_plan_condition *c = &s->plan.conditions[condition];
    const struct ls_published *p = ls_takedir_find(take, c->id, camera);
    uint8_t *bytes;
    size_t n;
    struct ls_image image = {0};
    struct ls_exr_attrs attrs = {0};
    g_assert_nonnull(p);
    g_assert_cmpint(ls_takedir_read(take, p, &bytes, &n, NULL), ==, LS_OK);
    g_assert_cmpint(ls_exr_read(bytes, n, NULL, 1 << 24, &image, &attrs, NULL), ==, LS_OK);
    float value = image.pixels[FAKE_WIDTH * (FAKE_HEIGHT / 2) + 5];
    if (c->dark) {
        g_assert_cmpfloat(value, ==, FAKE_BLACK);
    } else {
        double e = FAKE_RATE * (1 + c->light) * 1e6 / FAKE_FULL_SCALE * REFERENCE_S;
        /* half: 2^-11; the raw value is rounded to whole DN of 50 and more; Timed: register */
        g_assert_cmpfloat(fabs(value - e), <, 0.012 * e);
        g_assert_cmpint(ls_exr_attrs_find(&attrs, "lightstage/light")->i, ==, c->light);
    }
    ls_exr_attrs_finish(&attrs);
    ls_image_finish(&image);
    free(bytes);
}

void expect_complete(struct stage *s)
{
    struct ls_takedir *take;
    struct ls_take_report report;
    uint32_t n_cameras = s->config.n_cameras;
    g_assert_cmpuint(s->report.missing_conditions, ==, 0);
    g_assert_cmpuint(s->report.final.steps_bound, ==, s->plan.n_steps);
    g_assert_cmpuint(s->report.final.conditions_stored, ==, s->plan.n_conditions);
    g_assert_cmpint(ls_takedir_open(s->folder, &take, NULL), ==, LS_OK);
    g_assert_cmpint(ls_takedir_verify(take, &report, NULL), ==, LS_OK);
    g_assert_cmpstr(report.text, ==, "");
    g_assert_cmpuint(report.shots_ticketed, ==, s->plan.n_steps * n_cameras);
    g_assert_cmpuint(report.pictures_good, ==, s->plan.n_conditions * n_cameras);
    g_assert_cmpuint(count_mislabeled(s, take), ==, 0);
    for (uint32_t i = 0; i < s->plan.n_conditions; i++)
        for (uint32_t k = 0; k < n_cameras; k++)
            check_picture(s, take, i, k);
    ls_take_report_finish(&report);
    ls_takedir_close(take);
}

/* ---- resuming ---- */

/* What an earlier run left, as the engine reads it from the take's folder. */
static uint32_t read_done(struct stage *s)
{
    struct ls_takedir *take;
    uint32_t steps = 0;
    g_assert_cmpint(ls_takedir_open(s->folder, &take, NULL), ==, LS_OK);
    for (uint32_t i = 0; i < s->plan.n_conditions; i++) {
        const struct ls_published *p = ls_takedir_find(take, s->ids[i], 0);
        uint8_t *bytes;
        size_t n;
        struct ls_image image = {0};
        s->done[i] = p != NULL;
        steps += p ? s->conditions[i].n_steps : 0;
        if (!p || !s->conditions[i].dark || s->conditions[i].watch)
            continue;
        g_assert_cmpint(ls_takedir_read(take, p, &bytes, &n, NULL), ==, LS_OK);
        g_assert_cmpint(ls_exr_read(bytes, n, NULL, 1 << 24, &image, NULL, NULL), ==, LS_OK);
        s->darks[s->conditions[i].exposure] = image.pixels;
        free(bytes);
    }
    ls_takedir_close(take);
    return steps;
}

void resume(struct stage *s)
{
    ls_capture_destroy(s->capture);
    g_assert_cmpint(ls_store_close(s->store, NULL), ==, LS_OK);
    g_clear_pointer(&s->rig, fake_rig_free);
    uint32_t done = read_done(s);
    uint64_t settled = s->metrics.cameras[0].settling_pulses;
    g_assert_cmpint(ls_store_reopen(s->folder, 1 << 20, 0, NULL, &s->store, &s->diag), ==, LS_OK);
    s->setup.store = s->store;
    s->setup.condition_done = s->done;
    s->setup.darks = (const float *const *)s->darks;
    plug_in(s);
    g_assert_cmpint(ls_capture_create(&s->setup, &s->capture, &s->diag), ==, LS_OK);
    g_assert_cmpint(ls_capture_run(s->capture, &s->report, &s->diag), ==, LS_OK);
    g_assert_cmpstr(s->report.repaired, ==, "");
    uint32_t planned = s->report.final.steps_planned;
    settled = s->metrics.cameras[0].settling_pulses - settled;
    g_assert_cmpuint(fake_rig_pulses(s->rig), ==, planned + settled);
    g_assert_cmpuint(s->report.final.steps_bound, ==, planned);
    if (s->options.timed) /* what waited on disk is not shot again */
        g_assert_cmpuint(planned, <, s->plan.n_steps - done);
    else
        g_assert_cmpuint(planned, ==, s->plan.n_steps - done);
}
