/* flashing: what a live subject may be shown, by the plan and by the clock. */
#include "daemon/flashing.h"

#include <glib.h>
#include <string.h>

enum { LIGHTS = 200, MAX_PLAN = 1200, W = 0, R = 1, DEEP = 2, G = 3 };

struct scene {
    struct ls_config config;
    struct ls_lights_info lights;
    struct ls_plan plan;
    struct ls_plan_condition conditions[MAX_PLAN];
    struct ls_plan_step steps[MAX_PLAN];
    struct ls_led leds[MAX_PLAN];
    struct ls_spectrum deep;
    struct ls_diag diag;
};

/* A live subject; channel 2 is red by its spectrum. */
static struct scene *scene_of(uint32_t n_exposures, uint32_t period_us)
{
    static char names[][8] = {"W", "R", "deep", "G"};
    struct scene *s = g_new0(struct scene, 1);
    s->config.n_channels = 4;
    for (int i = 0; i < 4; i++)
        s->config.channels[i].name = names[i];
    for (int nm = 640; nm <= 680; nm += LS_SPECTRUM_STEP_NM)
        s->deep.v[(nm - LS_SPECTRUM_FIRST_NM) / LS_SPECTRUM_STEP_NM] = 1;
    s->config.channels[DEEP].spectrum = &s->deep;
    s->lights = (struct ls_lights_info){.n_lights = LIGHTS, .n_channels = 4};
    s->plan = (struct ls_plan){.subject = LS_SUBJECT_LIVE,
                               .period_us = period_us,
                               .settle_us = 100,
                               .n_exposures = n_exposures,
                               .pulse_us = {500, 2500, 12500},
                               .conditions = s->conditions,
                               .steps = s->steps};
    return s;
}

/* channel -1: dark */
static void show(struct scene *s, enum ls_condition_kind kind, int channel, uint16_t level)
{
    uint32_t i = s->plan.n_conditions++;
    g_assert_cmpuint(i, <, MAX_PLAN);
    s->leds[i] = (struct ls_led){.light = (uint16_t)(i % LIGHTS),
                                 .channel = (uint16_t)(channel < 0 ? 0 : channel),
                                 .level = level};
    s->conditions[i].lights = (struct ls_condition){kind, channel >= 0, &s->leds[i]};
    for (uint8_t e = 0; e < s->plan.n_exposures; e++) {
        g_assert_cmpuint(s->plan.n_steps, <, MAX_PLAN);
        s->steps[s->plan.n_steps++] = (struct ls_plan_step){.condition = i, .exposure = e};
    }
}

static void lights(struct scene *s, int n, int channel)
{
    for (int i = 0; i < n; i++)
        show(s, LS_CONDITION_ONE, channel, 65535);
}

static void darks(struct scene *s, int n)
{
    for (int i = 0; i < n; i++)
        show(s, LS_CONDITION_DARK, -1, 0);
}

static void judge(struct scene *s, bool stepwise, const char *sentence)
{
    enum ls_err err = ls_flashing_check(&s->plan, &s->config, &s->lights, stepwise, &s->diag);
    g_test_message("%s", s->diag.text);
    g_assert_cmpint(err, ==, sentence ? LS_ERR_REFUSED : LS_OK);
    g_assert_true(!sentence || strstr(s->diag.text, sentence));
    if (sentence) { /* a still subject may be shown anything, a live one if its operator says so */
        s->plan.allow_flashing = true;
        g_assert_cmpint(ls_flashing_check(&s->plan, &s->config, &s->lights, stepwise, NULL), ==,
                        LS_OK);
        s->plan.allow_flashing = false;
        s->plan.subject = LS_SUBJECT_STILL;
        g_assert_cmpint(ls_flashing_check(&s->plan, &s->config, &s->lights, stepwise, NULL), ==,
                        LS_OK);
    }
    g_free(s);
}

static void test_72(void)
{
    struct scene *s = scene_of(1, 13889);
    darks(s, 64);
    lights(s, 346, W);
    judge(s, false, NULL);
}

static void test_three_exposures(void)
{
    struct scene *s = scene_of(3, 13889);
    lights(s, 50, W);
    judge(s, false, "lights change at 24.0 Hz (3 exposures at 72.0 Hz)");
    s = scene_of(2, 13889); /* 36 Hz */
    lights(s, 50, W);
    judge(s, false, NULL);
}

static void test_band(void)
{
    static const struct {
        uint32_t period_us;
        const char *sentence;
    } paces[] = {
        {33332, NULL},
        {33333, "pulses at 30.0 Hz"},
        {50000, "pulses at 20.0 Hz"},
        {333333, "pulses at 3.0 Hz"},
        {333334, NULL},
        {1000000, NULL},
    };
    for (size_t i = 0; i < G_N_ELEMENTS(paces); i++) {
        struct scene *s = scene_of(1, paces[i].period_us);
        lights(s, 20, W);
        judge(s, false, paces[i].sentence);
    }
}

static void test_bright(void)
{
    struct scene *s = scene_of(1, 13889);
    for (int i = 0; i < 5; i++) { /* a bright picture 72 / 10 times a second */
        show(s, LS_CONDITION_SPHERE, W, 6000);
        lights(s, 9, W);
    }
    judge(s, false, "bright pulses at 7.2 Hz");
    static const struct {
        uint16_t level; /* of every second bright picture */
        const char *sentence;
    } seconds[] = {{3000, "bright pulses at 7.2 Hz"}, {2999, "bright pulses at 3.6 Hz"}};
    for (size_t k = 0; k < G_N_ELEMENTS(seconds); k++) { /* half as bright is bright */
        s = scene_of(1, 13889);
        for (int i = 0; i < 10; i++) {
            show(s, LS_CONDITION_SPHERE, W, i % 2 ? seconds[k].level : 6000);
            lights(s, 9, W);
        }
        judge(s, false, seconds[k].sentence);
    }
    s = scene_of(1, 13889);
    for (int i = 0; i < 5; i++) { /* 72 / 51 times */
        show(s, LS_CONDITION_SPHERE, W, 6000);
        lights(s, 50, W);
    }
    judge(s, false, NULL);
}

static void test_colours(void)
{
    struct scene *s = scene_of(1, 13889);
    for (int i = 0; i < 40; i++) { /* each colour 24 times a second, pulses at 72 Hz */
        show(s, LS_CONDITION_ONE, R, 65535);
        show(s, LS_CONDITION_ONE, G, 65535);
        show(s, LS_CONDITION_ONE, W, 65535);
    }
    judge(s, false, "red flash at 24.0 Hz");
    s = scene_of(1, 13889);
    for (int i = 0; i < 40; i++) {
        lights(s, 3, W);
        show(s, LS_CONDITION_ONE, G, 65535);
    }
    judge(s, false, "channel G flash at 18.0 Hz");
    s = scene_of(1, 13889); /* two reds, each every second and a half */
    for (int i = 0; i < 6; i++) {
        show(s, LS_CONDITION_ONE, i % 2 ? R : DEEP, 65535);
        lights(s, 19, W);
    }
    judge(s, false, "red flash at 3.6 Hz");
    s = scene_of(1, 13889); /* one colour after the other */
    lights(s, 100, W);
    lights(s, 100, G);
    lights(s, 100, R);
    judge(s, false, NULL);
}

/* Red in turn with a light of which @tenths shine beyond 600 nm, each every 0.56 s. */
static struct scene *red_and(int tenths)
{
    struct scene *s = scene_of(1, 13889);
    struct ls_spectrum *mixed = &s->deep;
    memset(mixed, 0, sizeof *mixed);
    for (int i = 0; i < 10; i++)
        mixed->v[(600 - LS_SPECTRUM_FIRST_NM) / LS_SPECTRUM_STEP_NM + tenths - 1 - i] = 1;
    for (int i = 0; i < 6; i++) {
        show(s, LS_CONDITION_ONE, i % 2 ? R : DEEP, 65535);
        lights(s, 19, W);
    }
    return s;
}

static void test_red(void)
{
    judge(red_and(8), false, "red flash at 3.6 Hz");
    judge(red_and(7), false, NULL);
}

static void test_gaps(void)
{
    struct scene *s = scene_of(1, 13889);
    for (int i = 0; i < 8; i++) { /* dark four times in a row, 4.5 times a second */
        lights(s, 12, W);
        darks(s, 4);
    }
    judge(s, false, "pulses at 4.5 Hz");
    s = scene_of(1, 13889);
    for (int i = 0; i < 8; i++) { /* as plans watch for drift */
        lights(s, LS_WATCH_EVERY, W);
        darks(s, 4);
    }
    judge(s, false, NULL);
}

static void test_stepwise(void)
{
    struct scene *s = scene_of(1, 13889);
    lights(s, 5, W);
    judge(s, true, "no fixed pace");
    s = scene_of(1, 333334);
    lights(s, 5, W);
    judge(s, true, NULL);
}

/* Pulses as they come: a pause is a flash, four in a second are too many. */
static void test_late(void)
{
    struct scene *s = scene_of(1, 13889);
    struct ls_flashing f;
    struct ls_flash_found found;
    uint64_t us = 5000000000u;
    lights(s, 100, W);
    ls_flashing_init(&f, &s->plan, &s->config, &s->lights);
    for (uint32_t i = 0; i < 90; i++) {
        us += i % 20 == 0 ? 400000 : 13889; /* bursts, 400 ms apart or more */
        g_assert_false(ls_flashing_pulse(&f, us, 500, &s->conditions[i].lights, &found));
    }
    uint32_t flashes = 0;
    us += 2000000;
    while (!ls_flashing_pulse(&f, us += 100000, 500, &s->conditions[0].lights, &found))
        flashes++;
    g_assert_cmpuint(flashes, ==, 3);
    g_assert_cmpfloat(found.hz, ==, 10);
    g_assert_cmpuint(found.train, ==, LS_FLASH_PULSES);
    g_free(s);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/flashing/one-exposure-at-72-hz-does-not-flash", test_72);
    g_test_add_func("/flashing/three-exposures-at-72-hz-are-refused", test_three_exposures);
    g_test_add_func("/flashing/pulses-of-3-to-30-hz-are-refused-and-no-others", test_band);
    g_test_add_func("/flashing/bright-pictures-among-dim-ones-flash", test_bright);
    g_test_add_func("/flashing/colours-are-judged-one-by-one-and-red-apart", test_colours);
    g_test_add_func("/flashing/four-fifths-of-red-are-red", test_red);
    g_test_add_func("/flashing/dark-gaps-flash-too", test_gaps);
    g_test_add_func("/flashing/one-step-at-a-time-has-no-pace", test_stepwise);
    g_test_add_func("/flashing/late-pulses-are-noticed-as-they-come", test_late);
    return g_test_run();
}
