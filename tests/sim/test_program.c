/* The controller's own judgement of programs, against the driver's, and against hostile images. */
#include "drivers/lights_image.h"
#include "sim/program.h"

#include <glib.h>
#include <math.h>
#include <string.h>

enum { MAX_CONDITIONS = 6, MAX_STEPS = 40, MAX_LEDS = 12 };

struct random_program {
    struct ls_led leds[MAX_CONDITIONS][MAX_LEDS];
    struct ls_condition conditions[MAX_CONDITIONS];
    struct ls_step steps[MAX_STEPS];
    struct ls_program program;
};

static struct sim_controller_config small(void)
{
    struct sim_controller_config config;
    sim_controller_defaults(&config);
    config.n_lights = 6;
    config.n_channels = 2;
    config.min_period_us = 1000;
    config.max_current_ma = 3500; /* five LEDs */
    config.max_duty_permille = 100;
    config.pwm_levels = 65536; /* every level is its own: both sides judge the same numbers */
    return config;
}

static struct ls_lights_info info_of(const struct sim_controller_config *c)
{
    return (struct ls_lights_info){.contract = 1,
                                   .n_lights = c->n_lights,
                                   .n_channels = c->n_channels,
                                   .pwm_period_us = c->pwm_period_us,
                                   .pwm_levels = c->pwm_levels,
                                   .min_pulse_us = c->min_pulse_us,
                                   .max_pulse_us = c->max_pulse_us,
                                   .min_period_us = c->min_period_us,
                                   .max_duty_permille = c->max_duty_permille,
                                   .max_current_ma = c->max_current_ma,
                                   .led_current_ma = c->led_current_ma,
                                   .max_conditions = c->max_conditions,
                                   .max_steps = c->max_steps,
                                   .max_program_bytes = c->max_program_bytes,
                                   .max_hold_us = c->max_hold_us,
                                   .heartbeat_ms = c->heartbeat_ms};
}

static uint32_t below(uint32_t n)
{
    return (uint32_t)g_test_rand_int_range(0, (gint32)n);
}

static void random_condition(struct ls_condition *c, struct ls_led *leds, bool wild)
{
    c->kind = (enum ls_condition_kind)below(5);
    c->leds = leds;
    c->n_leds = c->kind == LS_CONDITION_DARK                                    ? 0
                : c->kind == LS_CONDITION_ONE || c->kind == LS_CONDITION_SPHERE ? 1
                                                                                : 1 + below(5);
    uint16_t channel = (uint16_t)below(wild ? 3 : 2);
    uint16_t level = below(2) ? 65535 : (uint16_t)below(65536);
    uint16_t first = (uint16_t)below(wild ? 3 : 2);
    for (uint32_t k = 0; k < c->n_leds; k++)
        leds[k] = (struct ls_led){(uint16_t)(first + k - (wild && !below(12))), channel, level};
    for (uint32_t k = 0; c->kind == LS_CONDITION_LIST && k < c->n_leds; k++) {
        leds[k].channel = (uint16_t)((channel + k) % 2);
        leds[k].level = (uint16_t)below(65536);
    }
    if (c->kind == LS_CONDITION_SPHERE)
        leds[0].level = (uint16_t)(50000 + below(10000)); /* around the current limit */
}

static void random_program(struct random_program *r, bool wild)
{
    uint32_t n = 1 + below(MAX_CONDITIONS), n_steps = 1 + below(MAX_STEPS);
    for (uint32_t i = 0; i < n; i++)
        random_condition(&r->conditions[i], r->leds[i], wild);
    for (uint32_t i = 0; i < n_steps; i++)
        r->steps[i] = (struct ls_step){.condition = below(n + (wild && !below(20))),
                                       .pulse_us = 50 * below(300),
                                       .settle_us = below(2) ? 0 : below(300000),
                                       .flags = below(2)};
    r->program =
        (struct ls_program){r->conditions, n, r->steps, n_steps, 900 + below(wild ? 2000 : 200000)};
}

static void check_decoded(const struct random_program *r, const struct sim_program *p,
                          const struct sim_controller_config *config)
{
    g_assert_cmpuint(p->n_conditions, ==, r->program.n_conditions);
    g_assert_cmpuint(p->n_steps, ==, r->program.n_steps);
    g_assert_cmpuint(p->period_us, ==, r->program.period_us);
    for (uint32_t i = 0; i < p->n_conditions; i++) {
        const struct ls_condition *c = &r->conditions[i];
        bool sphere = c->kind == LS_CONDITION_SPHERE;
        g_assert_cmpuint(p->conditions[i].kind, ==, c->kind);
        g_assert_cmpuint(p->conditions[i].n_leds, ==, sphere ? config->n_lights : c->n_leds);
        for (uint32_t k = 0; k < p->conditions[i].n_leds; k++) {
            const struct sim_led *led = &p->conditions[i].leds[k];
            const struct ls_led *asked = &c->leds[sphere ? 0 : k];
            g_assert_cmpuint(led->light, ==, sphere ? k : asked->light);
            g_assert_cmpuint(led->channel, ==, asked->channel);
            /* a float holds 65535ths to half a unit of its last place */
            g_assert_cmpfloat(fabs((double)led->duty - asked->level / 65535.0), <, 1e-7);
        }
    }
    for (uint32_t i = 0; i < p->n_steps; i++) {
        g_assert_cmpuint(p->steps[i].condition, ==, r->steps[i].condition);
        g_assert_cmpuint(p->steps[i].pulse_us, ==, r->steps[i].pulse_us);
        g_assert_cmpuint(p->steps[i].settle_us, ==, r->steps[i].settle_us);
        g_assert_cmpuint(p->steps[i].flags, ==, r->steps[i].flags);
    }
}

/** Both judges, same program; the driver's verdict or LS_OK. */
static enum ls_err judge(const struct random_program *r, const struct sim_controller_config *config)
{
    struct ls_lights_info info = info_of(config);
    struct ls_diag diag = {0};
    struct sim_program decoded;
    struct sim_refusal refusal = {0};
    enum ls_err err = ls_lights_test(&info, &r->program, &diag);
    LS_CLEANUP_FREE uint16_t *image = g_malloc0(2 * ls_image_registers(&r->program));
    size_t n = ls_image_encode(&r->program, image);
    g_assert_cmpuint(n, ==, ls_image_registers(&r->program));
    int rc = sim_program_decode(config, image, n, &decoded, &refusal);
    if ((err == LS_OK) != (rc == 0))
        g_test_message("driver: %s; controller: reason %u detail %u", diag.text, refusal.reason,
                       refusal.detail);
    g_assert_cmpint(err == LS_OK, ==, rc == 0);
    if (!err)
        check_decoded(r, &decoded, config);
    else
        g_assert_cmpstr(diag.text, !=, "");
    sim_program_finish(&decoded);
    return err;
}

static void test_agree(void)
{
    struct sim_controller_config config = small();
    static struct random_program r;
    unsigned verdicts[LS_ERR_ABORTED + 1] = {0};
    for (int i = 0; i < 20000; i++) {
        random_program(&r, i % 2);
        verdicts[judge(&r, &config)]++;
    }
    g_test_message("accepted %u, malformed %u, over a limit %u", verdicts[LS_OK],
                   verdicts[LS_ERR_INVALID], verdicts[LS_ERR_LIMIT]);
    /* the sample must hold plenty of each */
    g_assert_cmpuint(verdicts[LS_OK], >, 500);
    g_assert_cmpuint(verdicts[LS_ERR_INVALID], >, 500);
    g_assert_cmpuint(verdicts[LS_ERR_LIMIT], >, 500);
}

struct limit {
    const char *says; /* in the driver's sentence */
    uint16_t reason;  /* of the controller */
    uint16_t faults;
    struct ls_led led;
    enum ls_condition_kind kind;
    uint32_t pulse_us, period_us, condition;
};

static void test_limits(void)
{
    static const struct limit limits[] = {
        {"current 4200 mA: 700 mA over",
         LS_WIRE_REFUSED_CURRENT,
         LS_WIRE_FAULT_OVERCURRENT,
         {0, 0, 65535},
         LS_CONDITION_SPHERE,
         100,
         1000,
         0},
        {"pulse 40 us: 10 us shorter",
         LS_WIRE_REFUSED_PULSE,
         LS_WIRE_FAULT_PROGRAM,
         {0, 0, 65535},
         LS_CONDITION_ONE,
         40,
         1000,
         0},
        {"pulse 500050 us: 50 us longer",
         LS_WIRE_REFUSED_PULSE,
         LS_WIRE_FAULT_PROGRAM,
         {0, 0, 65535},
         LS_CONDITION_ONE,
         500050,
         1000,
         0},
        {"120 us is 20 us over a whole number",
         LS_WIRE_REFUSED_PWM,
         LS_WIRE_FAULT_PROGRAM,
         {0, 0, 1000},
         LS_CONDITION_ONE,
         120,
         1000,
         0},
        {"period 999 us: 1 us shorter",
         LS_WIRE_REFUSED_PERIOD,
         LS_WIRE_FAULT_PROGRAM,
         {0, 0, 65535},
         LS_CONDITION_ONE,
         100,
         999,
         0},
        {"on for 120.000 ms of a second, 20.000 ms over",
         LS_WIRE_REFUSED_DUTY,
         LS_WIRE_FAULT_OVERDUTY,
         {0, 0, 65535},
         LS_CONDITION_ONE,
         60000,
         1000,
         0},
        {"light address 6: expected 0..5",
         LS_WIRE_REFUSED_LIGHT,
         LS_WIRE_FAULT_PROGRAM,
         {6, 0, 65535},
         LS_CONDITION_ONE,
         100,
         1000,
         0},
        {"channel 2: expected 0..1",
         LS_WIRE_REFUSED_CHANNEL,
         LS_WIRE_FAULT_PROGRAM,
         {0, 2, 65535},
         LS_CONDITION_ONE,
         100,
         1000,
         0},
        {"condition 1: expected 0..0",
         LS_WIRE_REFUSED_CONDITION,
         LS_WIRE_FAULT_PROGRAM,
         {0, 0, 65535},
         LS_CONDITION_ONE,
         100,
         1000,
         1},
    };
    struct sim_controller_config config = small();
    struct ls_lights_info info = info_of(&config);
    for (size_t i = 0; i < G_N_ELEMENTS(limits); i++) {
        const struct limit *l = &limits[i];
        struct ls_condition condition = {l->kind, 1, &l->led};
        struct ls_step steps[2] = {{0, l->pulse_us, 0, 0}, {l->condition, l->pulse_us, 0, 0}};
        struct ls_program program = {&condition, 1, steps, 2, l->period_us};
        uint16_t image[64];
        struct ls_diag diag = {0};
        struct sim_program decoded;
        struct sim_refusal refusal = {0};
        g_assert_cmpint(ls_lights_test(&info, &program, &diag), !=, LS_OK);
        if (!strstr(diag.text, l->says))
            g_test_message("%s", diag.text);
        g_assert_nonnull(strstr(diag.text, l->says));
        size_t n = ls_image_encode(&program, image);
        g_assert_cmpint(sim_program_decode(&config, image, n, &decoded, &refusal), !=, 0);
        g_assert_cmpuint(refusal.reason, ==, l->reason);
        g_assert_cmpuint(refusal.faults, ==, l->faults);
    }
}

static void test_capacity(void)
{
    struct sim_controller_config config = small();
    struct ls_lights_info info = info_of(&config);
    struct ls_led led = {0, 0, 65535};
    struct ls_condition conditions[2] = {{LS_CONDITION_ONE, 1, &led}, {LS_CONDITION_ONE, 1, &led}};
    struct ls_step steps[2] = {{0, 100, 0, 0}, {1, 100, 0, 0}};
    struct ls_program program = {conditions, 2, steps, 2, 1000};
    struct ls_diag diag = {0};
    info.max_program_bytes = 2 * (8 + 8 + 12) - 2; /* header, 2 conditions, 2 steps, less one */
    g_assert_cmpint(ls_lights_test(&info, &program, &diag), ==, LS_ERR_LIMIT);
    g_assert_nonnull(strstr(diag.text, "56 bytes: 2 more"));
    info.max_conditions = 1;
    g_assert_cmpint(ls_lights_test(&info, &program, &diag), ==, LS_ERR_LIMIT);
    g_assert_nonnull(strstr(diag.text, "2 conditions: 1 more"));
    info.max_conditions = 2;
    info.max_steps = 1;
    g_assert_cmpint(ls_lights_test(&info, &program, &diag), ==, LS_ERR_LIMIT);
    g_assert_nonnull(strstr(diag.text, "2 steps: 1 more"));
    program.n_steps = 0;
    g_assert_cmpint(ls_lights_test(&info, &program, &diag), ==, LS_ERR_INVALID);
}

/** The window slides: what was allowed for one second is allowed again in the next. */
static void test_window(void)
{
    struct sim_controller_config config = small();
    static struct random_program r;
    struct ls_led led = {0, 0, 65535};
    r.conditions[0] = (struct ls_condition){LS_CONDITION_ONE, 1, &led};
    for (uint32_t i = 0; i < MAX_STEPS; i++)
        r.steps[i] = (struct ls_step){0, 10000, 0, 0}; /* 10 ms: ten of them fill 100 permille */
    r.program = (struct ls_program){r.conditions, 1, r.steps, MAX_STEPS, 100000};
    g_assert_cmpint(judge(&r, &config), ==, LS_OK);
    r.program.period_us = 99999;
    g_assert_cmpint(judge(&r, &config), ==, LS_ERR_LIMIT);
}

static void test_hostile(void)
{
    struct sim_controller_config config = small();
    static struct random_program r;
    unsigned refused = 0;
    for (int i = 0; i < 20000; i++) {
        struct sim_program decoded;
        struct sim_refusal refusal = {0};
        random_program(&r, false);
        size_t n = ls_image_registers(&r.program);
        uint16_t *image = g_new0(uint16_t, n);
        ls_image_encode(&r.program, image);
        for (uint32_t k = below(4) + 1; k--;)
            image[below((uint32_t)n)] = below(3) ? (uint16_t)below(65536) : (uint16_t)below(8);
        size_t shown = below(3) ? n : below((uint32_t)n + 1);
        if (sim_program_decode(&config, image, shown, &decoded, &refusal)) {
            g_assert_cmpuint(refusal.reason, !=, LS_WIRE_REFUSED_NOT);
            refused++;
        }
        sim_program_finish(&decoded);
        g_free(image);
    }
    g_assert_cmpuint(refused, >, 10000);
}

static void test_quantised(void)
{
    struct sim_controller_config config = small();
    config.pwm_levels = 11;
    struct ls_led led = {2, 1, 65535 * 34 / 100};
    struct ls_condition condition = {LS_CONDITION_ONE, 1, &led};
    struct ls_step step = {0, 100, 0, 0};
    struct ls_program program = {&condition, 1, &step, 1, 1000};
    struct sim_program decoded;
    struct sim_refusal refusal;
    uint16_t image[32];
    size_t n = ls_image_encode(&program, image);
    g_assert_cmpint(sim_program_decode(&config, image, n, &decoded, &refusal), ==, 0);
    g_assert_cmpfloat(decoded.conditions[0].leds[0].duty, ==, 0.3f);
    sim_program_finish(&decoded);
}

static void test_crc(void)
{
    /* the iSCSI vector (RFC 3720, B.4) and the usual check value with a zero byte appended */
    const uint16_t zeros[16] = {0}, digits[5] = {0x3132, 0x3334, 0x3536, 0x3738, 0x3900};
    g_assert_cmphex(ls_wire_crc32c(zeros, 16), ==, 0x8a9136aa);
    g_assert_cmphex(ls_wire_crc32c(digits, 5), ==, 0xc3389d4f);
    g_assert_cmphex(ls_wire_crc32c(NULL, 0), ==, 0);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/program/crc-has-its-published-values", test_crc);
    g_test_add_func("/program/driver-and-controller-judge-alike", test_agree);
    g_test_add_func("/program/every-limit-is-named-with-its-excess", test_limits);
    g_test_add_func("/program/capacity-is-checked-before-upload", test_capacity);
    g_test_add_func("/program/the-duty-window-slides", test_window);
    g_test_add_func("/program/damaged-images-are-refused-not-crashed-on", test_hostile);
    g_test_add_func("/program/duties-are-quantised-to-the-hardware", test_quantised);
    return g_test_run();
}
