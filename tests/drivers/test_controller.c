/* The controller's side of the contract, spoken to register by register, without a driver. */
#include "drivers/lights_image.h"
#include "drivers/modbus/modbus.h"
#include "tests/drivers/dome_fixture.h"

#include <errno.h>
#include <glib.h>
#include <string.h>
#include <sys/socket.h>
#include <netinet/in.h>
#include <arpa/inet.h>
#include <unistd.h>

struct bench {
    struct dome dome;
    struct ls_link *link;
};

static struct bench bench_open(const struct sim_controller_config *config)
{
    struct bench b = {.dome = dome_start(config)};
    struct ls_diag diag = {0};
    struct ls_lights_config address = dome_address(&b.dome);
    g_assert_cmpint(ls_wire_modbus.create(&address, &b.link, &diag), ==, LS_OK);
    g_assert_cmpint(b.link->ops->connect(b.link, &diag), ==, LS_OK);
    return b;
}

static void bench_close(struct bench *b)
{
    b->link->ops->destroy(b->link);
    dome_stop(&b->dome);
}

static enum ls_err put(struct bench *b, unsigned address, unsigned n, const uint16_t *regs)
{
    return b->link->ops->write(b->link, address, n, regs, NULL);
}

static enum ls_err command(struct bench *b, uint16_t value)
{
    return put(b, LS_WIRE_CONTROL + LS_WIRE_CT_COMMAND, 1, &value);
}

static enum ls_err put32(struct bench *b, unsigned offset, uint32_t value)
{
    uint16_t regs[2];
    ls_wire_put32(regs, value);
    return put(b, LS_WIRE_CONTROL + offset, 2, regs);
}

static void status(struct bench *b, uint16_t *regs)
{
    g_assert_cmpint(b->link->ops->read(b->link, LS_WIRE_STATUS, LS_WIRE_STATUS_SIZE, regs, NULL),
                    ==, LS_OK);
}

static void upload(struct bench *b, const struct ls_program *program)
{
    uint16_t window[LS_WIRE_WINDOW_SIZE] = {0}, head[8];
    size_t n = ls_image_encode(program, window + LS_WIRE_WN_DATA);
    window[LS_WIRE_WN_LENGTH] = (uint16_t)n;
    g_assert_cmpint(put(b, LS_WIRE_WINDOW, LS_WIRE_WN_DATA + (unsigned)n, window), ==, LS_OK);
    ls_wire_put32(head, (uint32_t)(2 * n));
    ls_wire_put32(head + 2, ls_wire_crc32c(window + LS_WIRE_WN_DATA, n));
    ls_wire_put32(head + 4, program->n_conditions);
    ls_wire_put32(head + 6, program->n_steps);
    g_assert_cmpint(put(b, LS_WIRE_CONTROL + LS_WIRE_CT_BYTES, 8, head), ==, LS_OK);
}

static void test_latched(void)
{
    static const struct {
        struct ls_led led;
        enum ls_condition_kind kind;
        uint32_t pulse_us, period_us;
        uint16_t reason, faults;
    } over[] = {
        {{0, 0, 65535},
         LS_CONDITION_SPHERE,
         100,
         1000,
         LS_WIRE_REFUSED_CURRENT,
         LS_WIRE_FAULT_OVERCURRENT},
        {{0, 0, 65535},
         LS_CONDITION_ONE,
         300000,
         1000,
         LS_WIRE_REFUSED_DUTY,
         LS_WIRE_FAULT_OVERDUTY},
        {{0, 0, 65535}, LS_CONDITION_ONE, 10, 1000, LS_WIRE_REFUSED_PULSE, LS_WIRE_FAULT_PROGRAM},
        {{0, 0, 65535}, LS_CONDITION_ONE, 100, 500, LS_WIRE_REFUSED_PERIOD, LS_WIRE_FAULT_PROGRAM},
        {{0, 0, 9}, LS_CONDITION_ONE, 120, 1000, LS_WIRE_REFUSED_PWM, LS_WIRE_FAULT_PROGRAM},
        {{0, 0, 32767},
         LS_CONDITION_SPHERE,
         150000,
         1000,
         LS_WIRE_REFUSED_POWER,
         LS_WIRE_FAULT_OVERPOWER},
    };
    struct sim_controller_config config = dome_small();
    config.max_power_mw = 4000; /* 12 LEDs of 2.5 W at half their level, 0.3 of a second: 4.5 W */
    struct bench b = bench_open(&config);
    uint16_t regs[LS_WIRE_STATUS_SIZE];
    for (size_t i = 0; i < G_N_ELEMENTS(over); i++) {
        struct ls_condition condition = {over[i].kind, 1, &over[i].led};
        struct ls_step steps[2] = {{0, over[i].pulse_us, 0, 0}, {0, over[i].pulse_us, 0, 0}};
        struct ls_program program = {&condition, 1, steps, 2, over[i].period_us};
        upload(&b, &program);
        g_assert_cmpint(command(&b, LS_WIRE_COMMIT), ==, LS_ERR_REFUSED);
        status(&b, regs);
        g_assert_cmpuint(regs[LS_WIRE_ST_STATE], ==, LS_WIRE_FAULT);
        g_assert_cmpuint(regs[LS_WIRE_ST_FAULTS], ==, over[i].faults);
        g_assert_cmpuint(regs[LS_WIRE_ST_REFUSAL], ==, over[i].reason);
        g_assert_cmpint(command(&b, LS_WIRE_COMMIT), ==, LS_ERR_REFUSED); /* twice is no use */
        g_assert_cmpint(command(&b, LS_WIRE_ARM), ==, LS_ERR_REFUSED);
        status(&b, regs);
        g_assert_cmpuint(regs[LS_WIRE_ST_REFUSAL], ==, LS_WIRE_REFUSED_FAULT);
        g_assert_cmpint(command(&b, LS_WIRE_BLANK), ==, LS_OK); /* always; clears nothing */
        status(&b, regs);
        g_assert_cmpuint(regs[LS_WIRE_ST_FAULTS], ==, over[i].faults);
        g_assert_cmpint(command(&b, LS_WIRE_CLEAR_FAULTS), ==, LS_OK);
        status(&b, regs);
        g_assert_cmpuint(regs[LS_WIRE_ST_STATE], ==, LS_WIRE_IDLE);
    }
    g_assert_cmpuint(b.dome.log->n_commits, ==, 0);
    bench_close(&b);
}

static void refuses_work(struct bench *b, uint16_t channel, uint16_t level, uint16_t reason)
{
    const uint16_t work[2] = {channel, level};
    uint16_t regs[LS_WIRE_STATUS_SIZE];
    g_assert_cmpint(put(b, LS_WIRE_CONTROL + LS_WIRE_CT_WORK, 2, work), ==, LS_ERR_REFUSED);
    status(b, regs);
    g_assert_cmpuint(regs[LS_WIRE_ST_REFUSAL], ==, reason);
    g_assert_cmpuint(ls_wire_get32(regs + LS_WIRE_ST_DETAIL), ==,
                     reason == LS_WIRE_REFUSED_CHANNEL ? channel : level);
    g_assert_cmpuint(regs[LS_WIRE_ST_STATE], ==, LS_WIRE_IDLE);
}

static void test_work_refused(void)
{
    struct sim_controller_config config = dome_small();
    config.max_current_ma = 1000; /* 12 LEDs of 700 mA: level 7801 */
    config.max_power_mw = 2500;   /* 12 LEDs of 2.5 W: level 5461 */
    config.max_duty_permille = 200;
    struct bench b = bench_open(&config);
    uint16_t work[2] = {0, 5461}, regs[LS_WIRE_STATUS_SIZE];
    refuses_work(&b, 3, 1, LS_WIRE_REFUSED_CHANNEL);
    refuses_work(&b, 0, 13108, LS_WIRE_REFUSED_DUTY);
    refuses_work(&b, 0, 7802, LS_WIRE_REFUSED_CURRENT);
    refuses_work(&b, 0, 5462, LS_WIRE_REFUSED_POWER);
    g_assert_cmpint(put(&b, LS_WIRE_CONTROL + LS_WIRE_CT_WORK, 2, work), ==, LS_OK);
    g_assert_cmpint(command(&b, LS_WIRE_WORK), ==, LS_OK);
    status(&b, regs);
    g_assert_cmpuint(regs[LS_WIRE_ST_FLAGS], ==, LS_WIRE_FLAG_WORK);
    bench_close(&b);
}

static void test_checks(void)
{
    struct sim_controller_config config = dome_small();
    struct bench b = bench_open(&config);
    struct ls_led led = {0, 0, 65535};
    struct ls_condition condition = {LS_CONDITION_ONE, 1, &led};
    struct ls_step step = {0, 100, 0, 0};
    struct ls_program program = {&condition, 1, &step, 1, 1000};
    uint16_t regs[LS_WIRE_STATUS_SIZE];
    g_assert_cmpint(command(&b, LS_WIRE_ARM), ==, LS_ERR_REFUSED);
    g_assert_cmpint(command(&b, 99), ==, LS_ERR_REFUSED);
    upload(&b, &program);
    g_assert_cmpint(put32(&b, LS_WIRE_CT_CRC, 1), ==, LS_OK);
    g_assert_cmpint(command(&b, LS_WIRE_COMMIT), ==, LS_ERR_REFUSED);
    status(&b, regs);
    g_assert_cmpuint(regs[LS_WIRE_ST_REFUSAL], ==, LS_WIRE_REFUSED_CRC);
    upload(&b, &program);
    g_assert_cmpint(put32(&b, LS_WIRE_CT_STEPS, 2), ==, LS_OK);
    g_assert_cmpint(command(&b, LS_WIRE_COMMIT), ==, LS_ERR_REFUSED);
    status(&b, regs);
    g_assert_cmpuint(regs[LS_WIRE_ST_REFUSAL], ==, LS_WIRE_REFUSED_COUNTS);
    g_assert_cmpuint(regs[LS_WIRE_ST_STATE], ==, LS_WIRE_IDLE);
    g_assert_cmpint(put32(&b, LS_WIRE_CT_BYTES, UINT32_MAX), ==, LS_OK);
    g_assert_cmpint(command(&b, LS_WIRE_COMMIT), ==, LS_ERR_REFUSED);
    bench_close(&b);
}

static void test_registers(void)
{
    struct sim_controller_config config = dome_small();
    struct bench b = bench_open(&config);
    uint16_t regs[125] = {0};
    const unsigned outside[][2] = {{24, 1},    {20, 5},    {0x40, 39}, {0x100, 121}, {0x210, 1},
                                   {0x222, 1}, {0x37b, 1}, {65535, 1}, {65530, 100}};
    for (size_t i = 0; i < G_N_ELEMENTS(outside); i++)
        g_assert_cmpint(b.link->ops->read(b.link, outside[i][0], outside[i][1], regs, NULL), ==,
                        LS_ERR_UNSUPPORTED);
    g_assert_cmpint(put(&b, LS_WIRE_STATUS, 1, regs), ==, LS_ERR_UNSUPPORTED);
    g_assert_cmpint(put(&b, LS_WIRE_IDENTITY, 1, regs), ==, LS_ERR_UNSUPPORTED);
    g_assert_cmpint(put(&b, LS_WIRE_CONTROL + LS_WIRE_CT_GRANT, 1, regs), ==, LS_ERR_UNSUPPORTED);
    regs[LS_WIRE_WN_LENGTH] = 5;
    g_assert_cmpint(put(&b, LS_WIRE_WINDOW, 5, regs), ==, LS_ERR_REFUSED); /* wrong length */
    ls_wire_put32(regs, config.max_program_bytes / 2 - 1);
    regs[LS_WIRE_WN_LENGTH] = 2;
    g_assert_cmpint(put(&b, LS_WIRE_WINDOW, 5, regs), ==, LS_ERR_REFUSED); /* past the end */
    ls_wire_put32(regs, UINT32_MAX);
    g_assert_cmpint(put(&b, LS_WIRE_WINDOW, 5, regs), ==, LS_ERR_REFUSED);
    ls_wire_put32(regs, 1000);
    regs[3] = 0x1234;
    g_assert_cmpint(put(&b, LS_WIRE_WINDOW, 5, regs), ==, LS_OK);
    g_assert_cmpint(b.link->ops->read(b.link, LS_WIRE_WINDOW, 4, regs, NULL), ==, LS_OK);
    g_assert_cmphex(regs[3], ==, 0x1234);
    bench_close(&b);
}

/** Random bytes on the socket: the controller lives on and serves the next client. */
static void test_garbage(void)
{
    struct sim_controller_config config = dome_small();
    struct bench b = bench_open(&config);
    struct sockaddr_in sa = {.sin_family = AF_INET, .sin_port = htons((uint16_t)b.dome.port)};
    sa.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    for (int i = 0; i < 48; i++) {
        uint8_t bytes[300];
        size_t n = (size_t)g_test_rand_int_range(1, sizeof bytes);
        int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
        g_assert_no_errno(connect(fd, (struct sockaddr *)&sa, sizeof sa));
        for (size_t k = 0; k < n; k++)
            bytes[k] = (uint8_t)g_test_rand_int_range(0, 256);
        if (i % 2 && n > 12) { /* a plausible header with a hostile body */
            const uint8_t head[] = {0,
                                    1,
                                    0,
                                    0,
                                    (uint8_t)((n - 6) >> 8),
                                    (uint8_t)(n - 6),
                                    1,
                                    (const uint8_t[]){3, 6, 16, 23, 1, 43}[i / 2 % 6]};
            memcpy(bytes, head, sizeof head);
        }
        g_assert_cmpint(send(fd, bytes, n, MSG_NOSIGNAL), ==, n);
        close(fd);
    }
    uint16_t regs[LS_WIRE_IDENTITY_SIZE];
    enum ls_err err = LS_ERR_GONE; /* our connection may have been the oldest */
    for (int i = 0; i < 3 && err; i++) {
        err = b.link->ops->connect(b.link, NULL);
        if (!err)
            err = b.link->ops->read(b.link, LS_WIRE_IDENTITY, LS_WIRE_IDENTITY_SIZE, regs, NULL);
    }
    g_assert_cmpint(err, ==, LS_OK);
    g_assert_cmphex(regs[0], ==, LS_WIRE_MAGIC_0);
    bench_close(&b);
}

/* A host whose reply was lost sends its grant again: the step just lit must not go out. */
static void test_repeated_grant(void)
{
    struct sim_controller_config config = dome_small();
    struct bench b = bench_open(&config);
    const struct ls_led led = {0, 0, 65535};
    struct ls_condition condition = {LS_CONDITION_ONE, 1, &led};
    struct ls_step steps[2] = {{0, 100, 0, LS_STEP_HOLD}, {0, 100, 0, LS_STEP_HOLD}};
    struct ls_program program = {&condition, 1, steps, 2, 2000};
    uint16_t regs[LS_WIRE_STATUS_SIZE];
    upload(&b, &program);
    g_assert_cmpint(command(&b, LS_WIRE_COMMIT), ==, LS_OK);
    do
        status(&b, regs);
    while (regs[LS_WIRE_ST_STATE] == LS_WIRE_PREPARING);
    g_assert_cmpint(command(&b, LS_WIRE_ARM), ==, LS_OK);
    for (uint32_t granted = 1; granted <= 2; granted++) {
        g_assert_cmpint(put32(&b, LS_WIRE_CT_GRANT, granted), ==, LS_OK);
        do
            status(&b, regs);
        while (ls_wire_get32(regs + LS_WIRE_ST_FIRED) != granted ||
               !(regs[LS_WIRE_ST_FLAGS] & LS_WIRE_FLAG_HOLDING));
        uint64_t lit_us = ls_wire_get64(regs + LS_WIRE_ST_NOW_US);
        g_assert_cmpint(put32(&b, LS_WIRE_CT_GRANT, granted), ==, LS_OK);
        do { /* 20 ms: long enough for the engine to have put it out, far from the limit of 1 s */
            status(&b, regs);
            g_assert_true(regs[LS_WIRE_ST_FLAGS] & LS_WIRE_FLAG_HOLDING);
        } while (ls_wire_get64(regs + LS_WIRE_ST_NOW_US) < lit_us + 20000);
    }
    g_assert_cmpint(command(&b, LS_WIRE_RELEASE), ==, LS_OK);
    do
        status(&b, regs);
    while (regs[LS_WIRE_ST_STATE] != LS_WIRE_DONE);
    bench_close(&b);
}

static void test_power_failure(void)
{
    struct sim_controller_config config = dome_small();
    config.event_queue = 2;
    config.n_faults = 1;
    config.faults[0] = (struct sim_controller_fault){SIM_CONTROLLER_REBOOT, 3, 1, 0};
    struct bench b = bench_open(&config);
    const struct ls_led led = {0, 0, 65535};
    struct ls_condition condition = {LS_CONDITION_ONE, 1, &led};
    struct ls_step steps[4] = {{0, 100, 0, 0}, {0, 100, 0, 0}, {0, 100, 0, 0}, {0, 100, 0, 0}};
    struct ls_program program = {&condition, 1, steps, 4, 2000};
    uint16_t regs[LS_WIRE_STATUS_SIZE], nothing[LS_WIRE_STATUS_SIZE] = {0};
    upload(&b, &program);
    g_assert_cmpint(command(&b, LS_WIRE_COMMIT), ==, LS_OK);
    do
        status(&b, regs);
    while (regs[LS_WIRE_ST_STATE] == LS_WIRE_PREPARING);
    uint32_t boot = ls_wire_get32(regs + LS_WIRE_ST_BOOT);
    g_assert_cmpint(command(&b, LS_WIRE_ARM), ==, LS_OK);
    g_assert_cmpint(put32(&b, LS_WIRE_CT_GRANT, 5), ==, LS_ERR_REFUSED);
    g_assert_cmpint(put32(&b, LS_WIRE_CT_GRANT, 4), ==, LS_OK);
    while (!b.link->ops->read(b.link, LS_WIRE_STATUS, LS_WIRE_STATUS_SIZE, regs, NULL))
        ;
    g_assert_cmpint(b.link->ops->connect(b.link, NULL), ==, LS_OK);
    status(&b, regs);
    g_assert_cmpuint(ls_wire_get32(regs + LS_WIRE_ST_BOOT), !=, boot);
    memset(regs + LS_WIRE_ST_BOOT, 0, 2 * sizeof *regs);
    memset(regs + LS_WIRE_ST_NOW_US, 0, 4 * sizeof *regs);
    regs[LS_WIRE_ST_TEMPERATURE] = 0;
    g_assert_cmpmem(regs, sizeof regs, nothing, sizeof nothing);
    const unsigned blocks[][2] = {{LS_WIRE_CONTROL, LS_WIRE_CONTROL_SIZE},
                                  {LS_WIRE_WINDOW + LS_WIRE_WN_DATA, LS_WIRE_WINDOW_DATA}};
    for (size_t i = 0; i < G_N_ELEMENTS(blocks); i++) {
        g_assert_cmpint(b.link->ops->read(b.link, blocks[i][0], blocks[i][1], regs, NULL), ==,
                        LS_OK);
        g_assert_cmpmem(regs, 2 * blocks[i][1], nothing, 2 * blocks[i][1]);
    }
    bench_close(&b);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/controller/programs-over-a-limit-are-refused-and-latched", test_latched);
    g_test_add_func("/controller/a-work-light-over-a-limit-is-refused", test_work_refused);
    g_test_add_func("/controller/commit-checks-crc-and-counts", test_checks);
    g_test_add_func("/controller/only-documented-registers-exist", test_registers);
    g_test_add_func("/controller/a-repeated-grant-leaves-a-held-step-lit", test_repeated_grant);
    g_test_add_func("/controller/a-power-failure-leaves-nothing-behind", test_power_failure);
    g_test_add_func("/controller/garbage-does-not-stop-it", test_garbage);
    return g_test_run();
}
