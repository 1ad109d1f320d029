/* Conformance of lights drivers: the LEDs show what was asked, and a mistake on the way shows. */
#include "tests/drivers/lights_fixture.h"

#include <glib.h>
#include <math.h>
#include <string.h>

/** Did the LEDs of the log do what @program asks, at PWM resolution? */
static bool shows(const struct dome_log *log, const struct ls_program *program, uint32_t n_lights,
                  uint32_t pwm_levels)
{
    if (log->n_pulses != program->n_steps)
        return false;
    for (uint32_t i = 0; i < program->n_steps; i++) {
        const struct ls_condition *c = &program->conditions[program->steps[i].condition];
        uint32_t lit = log->pulses[i].condition;
        uint32_t n = c->kind == LS_CONDITION_SPHERE ? n_lights : c->n_leds;
        if (log->conditions[lit].n_leds != n)
            return false;
        for (uint32_t k = 0; k < n && k < DOME_LEDS; k++) {
            const struct sim_led *got = &log->conditions[lit].leds[k];
            const struct ls_led *asked = &c->leds[c->kind == LS_CONDITION_SPHERE ? 0 : k];
            uint32_t light = c->kind == LS_CONDITION_SPHERE ? k : asked->light;
            if (got->light != light || got->channel != asked->channel ||
                fabs(got->duty - asked->level / 65535.0) > 0.5 / (pwm_levels - 1) + 1e-6)
                return false;
        }
    }
    return true;
}

enum mutation { AS_ASKED, SWAPPED_LIGHTS, SWAPPED_VH, ONE_BASED, HALF_LEVEL, SHIFTED_STEPS };

/** Fire @program as a driver or controller with the given mistake would; what do the LEDs say? */
static bool fire_mutated(const struct driver *driver, enum mutation mutation)
{
    struct ls_led leds[8] = {{0, 0, 65535}, {1, 0, 65535}, {2, 1, 30000}, {3, 2, 65535},
                             {4, 0, 65535}, {5, 1, 65535}, {6, 2, 12345}, {7, 0, 65535}};
    struct ls_led wrong[8];
    struct ls_condition asked[9] = {{0}}, loaded[9] = {{0}};
    struct ls_step asked_steps[9], loaded_steps[9];
    memcpy(wrong, leds, sizeof wrong);
    for (int i = 0; i < 8; i++) {
        if (mutation == SWAPPED_LIGHTS && (i == 4 || i == 5))
            wrong[i].light = (uint16_t)(9 - i);
        if (mutation == SWAPPED_VH && leds[i].channel)
            wrong[i].channel = 3 - leds[i].channel;
        if (mutation == ONE_BASED)
            wrong[i].light++;
        if (mutation == HALF_LEVEL && i == 6)
            wrong[i].level /= 2;
        asked[i + 1] = (struct ls_condition){LS_CONDITION_ONE, 1, &leds[i]};
        loaded[i + 1] = (struct ls_condition){LS_CONDITION_ONE, 1, &wrong[i]};
    }
    for (uint32_t i = 0; i < 9; i++) {
        asked_steps[i] = loaded_steps[i] = (struct ls_step){i, 100, 0, 0};
        if (mutation == SHIFTED_STEPS)
            loaded_steps[i].condition = (i + 1) % 9;
    }
    struct ls_program program = {asked, 9, asked_steps, 9, 2000};
    struct ls_program mutated = {loaded, 9, loaded_steps, 9, 2000};
    struct sim_controller_config config = small(driver);
    struct stand s = stand_up(driver, &config);
    struct ls_step_event events[9];
    load(s.lights, &mutated);
    arm(s.lights);
    grant(s.lights, 9);
    collect(s.lights, events, 9);
    bool same = shows(s.dome.log, &program, config.n_lights, config.pwm_levels);
    stand_down(&s);
    return same;
}

static void test_shown(gconstpointer driver)
{
    g_assert_true(fire_mutated(driver, AS_ASKED));
}

static void test_swapped_lights(gconstpointer driver)
{
    g_assert_false(fire_mutated(driver, SWAPPED_LIGHTS));
}

static void test_swapped_vh(gconstpointer driver)
{
    g_assert_false(fire_mutated(driver, SWAPPED_VH));
}

static void test_one_based(gconstpointer driver)
{
    g_assert_false(fire_mutated(driver, ONE_BASED));
}

static void test_other_mutations(gconstpointer driver)
{
    g_assert_false(fire_mutated(driver, HALF_LEVEL));
    g_assert_false(fire_mutated(driver, SHIFTED_STEPS));
}

static void test_kinds_shown(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    struct stand s = stand_up(driver, &config);
    struct ls_step steps[12];
    struct ls_step_event events[12];
    struct ls_program program = small_program(steps, 12);
    load(s.lights, &program);
    arm(s.lights);
    grant(s.lights, 12);
    collect(s.lights, events, 12);
    g_assert_true(shows(s.dome.log, &program, config.n_lights, config.pwm_levels));
    stand_down(&s);
}

int main(int argc, char **argv)
{
    static const struct lights_test tests[] = {
        {"the-leds-show-what-was-asked", test_shown},
        {"every-kind-of-condition-is-shown", test_kinds_shown},
        {"mutation-swapped-lights-is-caught", test_swapped_lights},
        {"mutation-v-h-swap-is-caught", test_swapped_vh},
        {"mutation-one-based-lights-is-caught", test_one_based},
        {"mutation-level-and-step-shift-are-caught", test_other_mutations},
    };
    g_test_init(&argc, &argv, NULL);
    return run_lights_tests(tests, G_N_ELEMENTS(tests));
}
