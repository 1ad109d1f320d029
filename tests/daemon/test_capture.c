/*
 * capture: whole takes against a rig of fakes behind the drivers' interfaces; the real ring,
 * binding, merge and store.
 */
#include "core/exr.h"
#include "daemon/capture.h"
#include "daemon/findings.h"
#include "daemon/realtime.h"
#include "daemon/store.h"
#include "daemon/takedir.h"
#include "tests/daemon/fake_rig.h"
#include "tests/daemon/store_fixture.h"

#include <math.h>

enum {
    N_LIGHTS = 16,
    N_EXPOSURES = 3,
    N_DARKS = 3, /* per exposure */
    N_STEPS = N_EXPOSURES * (N_LIGHTS + N_DARKS),
    N_ALL = N_EXPOSURES + N_LIGHTS,
    N_WATCHES = 2, /* where a test wants them: one after each half of the lights */
    WATCH_FRAMES = 4,
    MAX_ALL = N_ALL + N_WATCHES,
    MAX_STEPS = N_STEPS + N_WATCHES * WATCH_FRAMES,
    PERIOD_US = 3000,
};

#define REFERENCE_S 1e-3

struct stage {
    char *root, *folder;
    struct fake_options options;
    struct fake_rig *rig;
    struct ls_config config;
    struct ls_config_light lights[N_LIGHTS];
    struct ls_plan plan;
    bool watches;
    struct ls_plan_condition conditions[MAX_ALL];
    struct ls_plan_step steps[MAX_STEPS];
    struct ls_led leds[N_LIGHTS];
    const char *ids[MAX_ALL];
    struct ls_disk_shim shim;
    struct ls_store *store;
    struct ls_capture *capture;
    struct ls_capture_report report;
    struct ls_diag diag;
    uint8_t done[MAX_ALL];
    float *darks[N_EXPOSURES];
};

static void make_config(struct stage *s)
{
    static char channel_name[] = "W", camera_names[][8] = {"front", "left"};
    s->config = (struct ls_config){.n_lights = N_LIGHTS,
                                   .lights = s->lights,
                                   .n_channels = 1,
                                   .n_cameras = s->options.n_cameras,
                                   .merge_threads = 2,
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
    s->plan = (struct ls_plan){.keep_raw = true,
                               .period_us = PERIOD_US,
                               .n_exposures = N_EXPOSURES,
                               .pulse_us = {100, 500, 2000},
                               .conditions = s->conditions,
                               .steps = s->steps,
                               .leds = s->leds};
    for (uint8_t e = 0; e < N_EXPOSURES; e++)
        add_condition(s, -1, e, N_DARKS);
    for (int i = 0; i < N_LIGHTS; i++) {
        add_condition(s, i, 0, N_EXPOSURES);
        if (s->watches && (i + 1) % (N_LIGHTS / N_WATCHES) == 0)
            add_watch(s, (i + 1) / (N_LIGHTS / N_WATCHES) - 1);
    }
}

static struct stage *new_stage(void)
{
    struct stage *s = g_new0(struct stage, 1);
    s->root = new_root();
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
                                           .keep_raw = true,
                                           .need_bytes = 1 << 20,
                                           .shim = s->shim.before ? &s->shim : NULL};
    g_assert_cmpint(ls_store_create(&config, &s->store, &s->diag), ==, LS_OK);
    s->folder = g_strdup(ls_store_folder(s->store));
}

static void set_up(struct stage *s)
{
    make_config(s);
    make_plan(s);
    s->rig = fake_rig_new(&s->options);
    open_store(s);
    const struct ls_capture_setup setup = {.config = &s->config,
                                           .plan = &s->plan,
                                           .lights = fake_rig_lights(s->rig),
                                           .cameras = fake_rig_cameras(s->rig),
                                           .store = s->store,
                                           .reference_exposure_s = REFERENCE_S};
    g_assert_cmpint(ls_capture_create(&setup, &s->capture, &s->diag), ==, LS_OK);
}

static enum ls_err shoot(struct stage *s)
{
    set_up(s);
    enum ls_err err = ls_capture_run(s->capture, &s->report, &s->diag);
    g_test_message("%s: %s", ls_err_name(err), s->diag.text);
    g_assert_true(fake_rig_is_dark(s->rig));
    g_assert_cmpuint(fake_rig_underruns(s->rig), ==, 0);
    return err;
}

static void clear(struct stage *s)
{
    ls_capture_destroy(s->capture);
    (void)ls_store_close(s->store, NULL);
    fake_rig_free(s->rig);
    remove_tree(s->root);
    g_free(s->root);
    g_free(s->folder);
    g_free(s);
}

/* ---- what a take must satisfy ---- */

/* Every kept frame shows what its ticket says it shows; returns how many do not. */
static uint32_t count_mislabeled(struct stage *s, const struct ls_takedir *take)
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
        if (!s->options.timed)
            right &= px[2] == s->plan.pulse_us[t->exposure] / 10 + 1;
        wrong += !right;
        g_free(bytes);
        g_free(path);
    }
    return wrong;
}

static void check_picture(struct stage *s, const struct ls_takedir *take, uint32_t condition,
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

/* All there, all right, nothing confused. */
static void expect_complete(struct stage *s)
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

/* ---- tests ---- */

static void test_whole(void)
{
    struct stage *s = new_stage();
    s->options.n_cameras = 2;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    g_assert_cmpuint(s->report.final.shots_lost, ==, 0);
    g_assert_cmpuint(fake_rig_pulses(s->rig), ==, s->plan.n_steps);
    /* both clocks are exact to 1 us of the controller */
    g_assert_cmpfloat(s->report.residual_max_us, <, 5);
    g_assert_cmpstr(s->report.repaired, ==, "");
    clear(s);
}

static void expect_repaired(enum fake_fault fault, uint32_t pulse, const char *repaired)
{
    struct stage *s = new_stage();
    s->options.faults[pulse] = (unsigned char)fault;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    g_assert_cmpuint(s->report.final.shots_lost, >=, 1);
    g_assert_cmpuint(s->report.final.shots_lost, ==, s->report.final.shots_repaired);
    g_assert_nonnull(strstr(s->report.repaired, repaired));
    clear(s);
}

enum { FIRST_LIGHT = N_EXPOSURES * N_DARKS };

static void test_dropped(void)
{
    expect_repaired(FAKE_DROPPED, FIRST_LIGHT + 3 * 5 + 1, "W-0005 (1 shot)");
    expect_repaired(FAKE_DROPPED, 4, "dark-1 (1 shot)");
}

static void test_lost(void)
{
    expect_repaired(FAKE_LOST, FIRST_LIGHT + 3 * 2, "W-0002 (1 shot)");
    expect_repaired(FAKE_VANISHED, FIRST_LIGHT + 3 * 2, "W-0002 (1 shot)");
}

static void test_lost_last(void)
{
    expect_repaired(FAKE_VANISHED, N_STEPS - 1, "W-0015 (1 shot)");
}

static void test_doubled(void)
{
    expect_repaired(FAKE_DOUBLED, FIRST_LIGHT + 3 * 7, "W-0007");
}

static void test_warm_up_faults(void)
{
    struct stage *s = new_stage();
    s->options.warm_up_faults[1] = FAKE_DROPPED;
    s->options.warm_up_faults[3] = FAKE_VANISHED;
    s->options.warm_up_faults[4] = FAKE_LOST;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    clear(s);
}

static void test_many_faults(void)
{
    struct stage *s = new_stage();
    guint32 seed = g_test_rand_int();
    GRand *rand = g_rand_new_with_seed(seed);
    g_test_message("seed %u", seed);
    s->options.n_cameras = 2;
    s->config.retries = 8;
    for (int i = FIRST_LIGHT; i < 400; i++)
        if (g_rand_double(rand) < 0.05)
            s->options.faults[i] = (unsigned char)g_rand_int_range(rand, 1, FAKE_DOUBLED + 1);
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    g_rand_free(rand);
    clear(s);
}

static void test_missing(void)
{
    struct stage *s = new_stage();
    struct ls_takedir *take;
    s->options.lose_light = 3;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    g_assert_cmpuint(s->report.missing_conditions, ==, 1);
    g_assert_cmpuint(s->report.final.conditions_stored, ==, s->plan.n_conditions - 1);
    g_assert_cmpint(ls_takedir_open(s->folder, &take, NULL), ==, LS_OK);
    bool named = false;
    for (size_t i = 0; i < take->n_alarms; i++)
        named |= strstr(take->alarms[i], "cam0/W-0003") != NULL;
    g_assert_true(named);
    g_assert_cmpuint(count_mislabeled(s, take), ==, 0);
    ls_takedir_close(take);
    clear(s);
}

static void test_corrupted_ticket(void)
{
    struct stage *s = new_stage();
    struct ls_takedir *take;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    g_assert_cmpint(ls_takedir_open(s->folder, &take, NULL), ==, LS_OK);
    g_assert_cmpuint(count_mislabeled(s, take), ==, 0);
    take->tickets[20].step += 3; /* the same exposure of the next light */
    take->tickets[20].condition += 1;
    g_assert_cmpuint(count_mislabeled(s, take), ==, 1);
    ls_takedir_close(take);
    clear(s);
}

static void test_stall(void)
{
    struct stage *s = new_stage();
    s->options.stall_at = FIRST_LIGHT + 10;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    g_assert_cmpuint(s->report.final.shots_lost, ==, 0);
    clear(s);
}

static void test_interlock(void)
{
    struct stage *s = new_stage();
    s->options.interlock_at = FIRST_LIGHT + 20;
    g_assert_cmpint(shoot(s), ==, LS_ERR_REFUSED);
    g_assert_nonnull(strstr(s->diag.text, "interlock open"));
    g_assert_nonnull(strstr(s->diag.text, "resume"));
    g_assert_cmpuint(s->report.final.conditions_stored, >=, N_EXPOSURES);
    clear(s);
}

static void test_camera_gone(void)
{
    struct stage *s = new_stage();
    s->options.gone_at = FIRST_LIGHT + 20;
    g_assert_cmpint(shoot(s), ==, LS_ERR_GONE);
    g_assert_nonnull(strstr(s->diag.text, "front"));
    g_assert_nonnull(strstr(s->diag.text, "resume"));
    clear(s);
}

static int fail_after(void *user, enum ls_disk_op op, const char *name, size_t *n_bytes)
{
    struct stage *s = user;
    return op == LS_DISK_WRITE && s->capture && fake_rig_pulses(s->rig) > FIRST_LIGHT + 9 ? ENOSPC
                                                                                          : 0;
}

static void test_store_error(void)
{
    struct stage *s = new_stage();
    s->shim = (struct ls_disk_shim){.before = fail_after, .user = s};
    g_assert_cmpint(shoot(s), ==, LS_ERR_FULL);
    g_assert_cmpuint(fake_rig_pulses(s->rig), <, s->plan.n_steps);
    clear(s);
}

static int slow_disk(void *user, enum ls_disk_op op, const char *name, size_t *n_bytes)
{
    if (op == LS_DISK_SYNC)
        g_usleep(10000);
    return 0;
}

static void test_slow_disk(void)
{
    struct stage *s = new_stage();
    s->shim = (struct ls_disk_shim){.before = slow_disk};
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s); /* shoot() has checked that no exposure found the ring full */
    clear(s);
}

static gpointer run_thread(gpointer data)
{
    struct stage *s = data;
    return GINT_TO_POINTER(ls_capture_run(s->capture, &s->report, &s->diag));
}

static void test_abort(void)
{
    struct stage *s = new_stage();
    set_up(s);
    GThread *thread = g_thread_new("run", run_thread, s);
    struct ls_capture_progress progress;
    do {
        g_thread_yield();
        ls_capture_progress(s->capture, &progress);
    } while (progress.steps_bound < FIRST_LIGHT + 6);
    uint64_t asked_ns = ls_host_ns();
    ls_capture_abort(s->capture);
    enum ls_err err = GPOINTER_TO_INT(g_thread_join(thread));
    g_assert_cmpint(err, ==, LS_ERR_ABORTED);
    g_assert_true(fake_rig_is_dark(s->rig));
    /* one poll of 1.5 ms, and a loaded machine's scheduling; a pulse already due may follow */
    g_assert_cmpint((int64_t)(fake_rig_last_lit_ns(s->rig) - asked_ns), <, 100000000);
    g_assert_cmpuint(s->report.final.conditions_stored, >=, N_EXPOSURES);
    clear(s);
}

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

static void resume(struct stage *s)
{
    ls_capture_destroy(s->capture);
    g_assert_cmpint(ls_store_close(s->store, NULL), ==, LS_OK);
    fake_rig_free(s->rig);
    uint32_t done = read_done(s);
    s->rig = fake_rig_new(&s->options);
    g_assert_cmpint(ls_store_reopen(s->folder, 1 << 20, 0, NULL, &s->store, &s->diag), ==, LS_OK);
    const struct ls_capture_setup setup = {.config = &s->config,
                                           .plan = &s->plan,
                                           .lights = fake_rig_lights(s->rig),
                                           .cameras = fake_rig_cameras(s->rig),
                                           .store = s->store,
                                           .reference_exposure_s = REFERENCE_S,
                                           .condition_done = s->done,
                                           .darks = (const float *const *)s->darks};
    g_assert_cmpint(ls_capture_create(&setup, &s->capture, &s->diag), ==, LS_OK);
    g_assert_cmpint(ls_capture_run(s->capture, &s->report, &s->diag), ==, LS_OK);
    g_assert_cmpuint(fake_rig_pulses(s->rig), ==, s->plan.n_steps - done);
    g_assert_cmpuint(s->report.final.steps_planned, ==, s->plan.n_steps - done);
    g_assert_cmpuint(s->report.final.steps_bound, ==, s->plan.n_steps - done);
}

static void test_resume(void)
{
    struct stage *s = new_stage();
    struct ls_takedir *take;
    struct ls_take_report report;
    s->options.interlock_at = FIRST_LIGHT + 20;
    g_assert_cmpint(shoot(s), ==, LS_ERR_REFUSED);
    s->options.interlock_at = 0;
    resume(s);
    g_assert_cmpuint(s->report.missing_conditions, ==, 0);
    g_assert_cmpint(ls_takedir_open(s->folder, &take, NULL), ==, LS_OK);
    g_assert_cmpint(ls_takedir_verify(take, &report, NULL), ==, LS_OK);
    g_assert_cmpstr(report.text, ==, "");
    g_assert_cmpuint(report.pictures_good, ==, s->plan.n_conditions);
    g_assert_cmpuint(count_mislabeled(s, take), ==, 0);
    for (uint32_t i = 0; i < s->plan.n_conditions; i++)
        check_picture(s, take, i, 0);
    ls_take_report_finish(&report);
    ls_takedir_close(take);
    for (int i = 0; i < N_EXPOSURES; i++)
        free(s->darks[i]);
    clear(s);
}

/* Alarms that begin with @text. */
static uint32_t count_alarms(struct stage *s, const char *text)
{
    struct ls_takedir *take;
    uint32_t n = 0;
    g_assert_cmpint(ls_takedir_open(s->folder, &take, NULL), ==, LS_OK);
    for (size_t i = 0; i < take->n_alarms; i++) {
        g_test_message("%s", take->alarms[i]);
        n += g_str_has_prefix(take->alarms[i], text);
    }
    ls_takedir_close(take);
    return n;
}

static void test_watches(void)
{
    struct stage *s = new_stage();
    s->watches = true;
    s->options.n_cameras = 2;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    g_assert_cmpuint(count_alarms(s, "dark drift"), ==, 0);
    clear(s);
}

enum { SECOND_HALF = FIRST_LIGHT + N_EXPOSURES * N_LIGHTS / 2 + WATCH_FRAMES };

static void test_drift(void)
{
    struct stage *s = new_stage();
    s->watches = true;
    s->options.n_cameras = 2;
    s->options.drift_at = SECOND_HALF;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    g_assert_cmpuint(s->report.missing_conditions, ==, 0);
    g_assert_cmpuint(count_alarms(s, "dark drift: camera front: watch-1 is +1.0"), ==, 1);
    g_assert_cmpuint(count_alarms(s, "dark drift: camera left: watch-1 is +1.0"), ==, 1);
    g_assert_cmpuint(count_alarms(s, "dark drift"), ==, 2);
    clear(s);
}

/* Both have a shot missing: the first is given up for the second, which is given up when the first
 * is shot again. */
static void test_lost_watches(void)
{
    struct stage *s = new_stage();
    s->watches = true;
    s->options.faults[SECOND_HALF - 2] = FAKE_LOST;
    s->options.faults[SECOND_HALF + N_EXPOSURES * N_LIGHTS / 2 + 1] = FAKE_VANISHED;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    g_assert_nonnull(strstr(s->report.repaired, "watch-0 (1 shot), watch-1 (1 shot)"));
    g_assert_cmpuint(fake_rig_pulses(s->rig), ==, s->plan.n_steps + 2 * WATCH_FRAMES);
    clear(s);
}

static void test_missing_watch(void)
{
    struct stage *s = new_stage();
    s->watches = true;
    s->options.faults[SECOND_HALF - 2] = FAKE_VANISHED;
    set_up(s);
    s->config.retries = 0;
    g_assert_cmpint(ls_capture_run(s->capture, &s->report, &s->diag), ==, LS_OK);
    g_assert_cmpuint(s->report.missing_conditions, ==, 1);
    g_assert_cmpuint(s->report.final.conditions_stored, ==, s->plan.n_conditions - 1);
    g_assert_cmpuint(count_alarms(s, "missing: cam0/watch-0"), ==, 1);
    clear(s);
}

static void test_resumed_watches(void)
{
    struct stage *s = new_stage();
    s->watches = true;
    s->options.interlock_at = SECOND_HALF + 4;
    g_assert_cmpint(shoot(s), ==, LS_ERR_REFUSED);
    s->options.interlock_at = 0;
    s->options.drift_at = 1;
    resume(s);
    g_assert_cmpuint(s->report.missing_conditions, ==, 0);
    g_assert_cmpuint(count_alarms(s, "dark drift: camera front: watch-1 is +1.0"), ==, 1);
    g_assert_cmpuint(count_alarms(s, "dark drift"), ==, 1);
    for (int i = 0; i < N_EXPOSURES; i++)
        free(s->darks[i]);
    clear(s);
}

static void check_clock(const struct ls_clock_finding *c, double ppm)
{
    g_test_message("%.2f ppm, residual %.2f us rms, %.2f us max", c->drift_ppm, c->residual_rms_us,
                   c->residual_max_us);
    g_assert_cmpuint(c->pairs, >=, 5);
    /* the controller counts whole us over a baseline of 0.2 s and more: 5 ppm, twice over */
    g_assert_cmpfloat(fabs(c->drift_ppm - ppm), <, 10);
    g_assert_cmpfloat(c->residual_max_us, <, 5);
}

static void test_findings(void)
{
    struct stage *s = new_stage();
    struct ls_findings found;
    s->options.n_cameras = 2;
    uint64_t began_ns = ls_host_ns();
    g_assert_cmpint(shoot(s), ==, LS_OK);
    ls_capture_findings(s->capture, &found);
    check_clock(&found.controller, -80);
    for (uint32_t i = 0; i < 2; i++) {
        check_clock(&found.cameras[i], 60);
        g_assert_cmpfloat(found.cameras[i].host_ns, >, began_ns);
        g_assert_cmpfloat(found.cameras[i].host_ns, <, ls_host_ns());
        for (uint32_t e = 0; e < N_EXPOSURES; e++) {
            const struct ls_dark_finding *d = &found.darks[i][e];
            g_assert_true(d->known);
            /* three pixels hold marks */
            g_assert_cmpfloat(fabs(d->mean_dn - FAKE_BLACK), <, 0.5);
            g_assert_cmpfloat(d->clipped, <=, 1.0 / (FAKE_WIDTH * FAKE_HEIGHT));
            g_assert_cmpfloat(d->read_noise_dn, <, 0.1);
        }
    }
    clear(s);
}

static void test_software(void)
{
    struct stage *s = new_stage();
    s->options.software = s->options.timed = s->options.no_time = true;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    clear(s);
}

static void test_software_lost(void)
{
    struct stage *s = new_stage();
    s->options.software = s->options.timed = s->options.no_time = true;
    s->options.faults[FIRST_LIGHT + 7] = FAKE_VANISHED;
    s->options.faults[N_STEPS - 1] = FAKE_LOST;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    /* the step after a missing one is out of order and shot again, too */
    g_assert_cmpuint(s->report.final.shots_lost, >=, 3);
    clear(s);
}

/* A light that is off when the camera exposes gives a dark picture of a lit step. */
static void test_software_dark(void)
{
    struct stage *s = new_stage();
    s->options.software = s->options.timed = s->options.no_time = true;
    s->options.faults[FIRST_LIGHT + 3 * 2] = FAKE_UNLIT;
    s->options.faults[FIRST_LIGHT + 3 * 6 + 2] = FAKE_CUT;
    s->options.faults[N_STEPS - 1] = FAKE_UNLIT;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    /* each of the three, and nothing else */
    g_assert_cmpuint(s->report.final.shots_lost, ==, 3);
    g_assert_nonnull(strstr(s->report.repaired, "W-0002 (1 shot)"));
    g_assert_nonnull(strstr(s->report.repaired, "W-0006 (1 shot)"));
    clear(s);
}

/* Two frames in a row, later than the patience of 328 ms: each comes while the next step is on. */
static void test_software_slow(void)
{
    struct stage *s = new_stage();
    s->options.software = s->options.timed = s->options.no_time = true;
    s->options.faults[FIRST_LIGHT + 3 * 5 + 1] = FAKE_SLOWER;
    s->options.faults[FIRST_LIGHT + 3 * 5 + 2] = FAKE_SLOWER;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    g_assert_cmpuint(s->report.final.shots_lost, ==, 2);
    clear(s);
}

/* The step's event comes with the end of the hold, long after the other camera's frame. */
static void test_mixed(void)
{
    struct stage *s = new_stage();
    s->options.n_cameras = 2;
    s->options.software = s->options.timed = s->options.no_time = s->options.mixed = true;
    s->options.faults[FIRST_LIGHT + 7] = FAKE_SLOW;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    g_assert_cmpuint(s->report.final.shots_lost, ==, 0);
    clear(s);
}

static void test_blank_fails(void)
{
    struct stage *s = new_stage();
    s->options.blank_fails = true;
    s->options.interlock_at = FIRST_LIGHT + 20;
    set_up(s);
    g_assert_cmpint(ls_capture_run(s->capture, &s->report, &s->diag), ==, LS_ERR_GONE);
    g_test_message("%s", s->diag.text); /* the darks' program is over, but not its light */
    g_assert_nonnull(strstr(s->diag.text, "controller unplugged"));
    g_assert_nonnull(strstr(s->diag.text, "LEDs may be lit"));
    clear(s);
    s = new_stage();
    s->options.blank_fails = true;
    s->options.interlock_at = 2;
    set_up(s);
    g_assert_cmpint(ls_capture_run(s->capture, &s->report, &s->diag), ==, LS_ERR_REFUSED);
    g_assert_nonnull(strstr(s->diag.text, "interlock open"));
    g_assert_nonnull(strstr(s->diag.text, "controller unplugged"));
    g_assert_nonnull(strstr(s->diag.text, "LEDs may be lit"));
    clear(s);
}

static void test_timed(void)
{
    struct stage *s = new_stage();
    s->options.timed = true;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    clear(s);
}

static void test_live(void)
{
    struct stage *s = new_stage();
    set_up(s);
    s->plan.subject = LS_SUBJECT_LIVE;
    g_assert_cmpint(ls_capture_run(s->capture, &s->report, &s->diag), ==, LS_OK);
    expect_complete(s);
    clear(s);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/capture/a-take-is-whole-and-every-ticket-is-true", test_whole);
    g_test_add_func("/capture/a-dropped-pulse-is-repaired", test_dropped);
    g_test_add_func("/capture/a-lost-frame-is-repaired", test_lost);
    g_test_add_func("/capture/a-lost-last-frame-is-repaired", test_lost_last);
    g_test_add_func("/capture/an-unasked-exposure-is-repaired", test_doubled);
    g_test_add_func("/capture/warm-up-survives-faults", test_warm_up_faults);
    g_test_add_func("/capture/a-mixture-of-faults-ends-complete", test_many_faults);
    g_test_add_func("/capture/what-cannot-be-had-is-named", test_missing);
    g_test_add_func("/capture/a-corrupted-ticket-is-counted", test_corrupted_ticket);
    g_test_add_func("/capture/a-stalling-controller-is-waited-for", test_stall);
    g_test_add_func("/capture/an-open-interlock-ends-the-take-with-its-name", test_interlock);
    g_test_add_func("/capture/a-camera-that-disappears-ends-the-take-dark", test_camera_gone);
    g_test_add_func("/capture/a-store-error-stops-the-take-dark", test_store_error);
    g_test_add_func("/capture/a-slow-disk-slows-the-take-and-loses-nothing", test_slow_disk);
    g_test_add_func("/capture/an-abort-is-dark-at-once", test_abort);
    g_test_add_func("/capture/a-resumed-take-shoots-only-what-is-missing", test_resume);
    g_test_add_func("/capture/watches-are-stored-and-silent-when-nothing-drifts", test_watches);
    g_test_add_func("/capture/a-black-level-that-drifts-is-an-alarm", test_drift);
    g_test_add_func("/capture/a-watch-given-up-is-shot-again-whole", test_lost_watches);
    g_test_add_func("/capture/a-missing-watch-does-not-stop-the-take", test_missing_watch);
    g_test_add_func("/capture/a-resumed-take-watches-against-its-first-darks",
                    test_resumed_watches);
    g_test_add_func("/capture/darks-and-clocks-are-found-as-they-are", test_findings);
    g_test_add_func("/capture/software-triggered-cameras-hold-the-light", test_software);
    g_test_add_func("/capture/a-software-triggered-camera-that-misses-is-repaired",
                    test_software_lost);
    g_test_add_func("/capture/a-held-light-that-goes-off-too-early-is-repaired",
                    test_software_dark);
    g_test_add_func("/capture/frames-later-than-patience-are-nobodys", test_software_slow);
    g_test_add_func("/capture/a-long-hold-costs-the-other-camera-nothing", test_mixed);
    g_test_add_func("/capture/a-failed-blank-is-told-whatever-went-wrong-before", test_blank_fails);
    g_test_add_func("/capture/timed-exposures-are-written-per-step", test_timed);
    g_test_add_func("/capture/a-live-subject-is-shot-in-bursts", test_live);
    return g_test_run();
}
