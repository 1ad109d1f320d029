/* What only one wire can suffer: late answers on a serial line; on USB packets that are lost or
 * damaged, a stalled endpoint, a pulled plug. The rest is test_lights.c's, for all wires. */
#include "drivers/dome.h"
#include "drivers/lights.h"
#include "drivers/modbus/modbus.h"
#include "drivers/usb/packet.h"
#include "drivers/usb/usb.h"
#include "tests/drivers/dome_fixture.h"

#include <fcntl.h>
#include <glib.h>
#include <libusb.h>
#include <poll.h>
#include <string.h>
#include <unistd.h>

enum { STEPS = 100, BOOT = 0x12345 };

/** What the driver's calls of libusb meet, and how often (linked with --wrap). */
static struct {
    unsigned cleared;    /* halts */
    unsigned to_shorten; /* event transfers to come that are too short for a packet */
    unsigned overflowed; /* event transfers seen again after they were */
} host;

int __real_libusb_clear_halt(libusb_device_handle *device, unsigned char endpoint);
int __wrap_libusb_clear_halt(libusb_device_handle *device, unsigned char endpoint);
int __real_libusb_submit_transfer(struct libusb_transfer *transfer);
int __wrap_libusb_submit_transfer(struct libusb_transfer *transfer);

int __wrap_libusb_clear_halt(libusb_device_handle *device, unsigned char endpoint)
{
    host.cleared++;
    return __real_libusb_clear_halt(device, endpoint);
}

int __wrap_libusb_submit_transfer(struct libusb_transfer *transfer)
{
    if (transfer->type == LIBUSB_TRANSFER_TYPE_INTERRUPT) {
        host.overflowed += transfer->status == LIBUSB_TRANSFER_OVERFLOW;
        transfer->length = host.to_shorten ? 16 : LS_WIRE_USB_PACKET_BYTES;
        host.to_shorten -= host.to_shorten > 0;
    }
    return __real_libusb_submit_transfer(transfer);
}

static const struct ls_led led = {3, 1, 65535};
static const struct ls_condition condition = {LS_CONDITION_ONE, 1, &led};

static void must(enum ls_err err, const struct ls_diag *diag)
{
    if (err)
        g_test_message("%s: %s", ls_err_name(err), diag->text);
    g_assert_cmpint(err, ==, LS_OK);
}

static struct sim_controller_config with_fault(enum sim_controller_wire wire,
                                               struct sim_controller_fault fault)
{
    struct sim_controller_config config = dome_small();
    config.wire = wire;
    config.n_faults = 1;
    config.faults[0] = fault;
    return config;
}

static struct ls_program program_of(struct ls_step steps[STEPS])
{
    for (int i = 0; i < STEPS; i++)
        steps[i] = (struct ls_step){.pulse_us = 100};
    return (struct ls_program){&condition, 1, steps, STEPS, 1000};
}

/** Fire STEPS steps of 1 ms and poll until every event is there, in order and once; 10 s. */
static void fire(struct ls_lights *lights)
{
    struct ls_step steps[STEPS];
    struct ls_step_event events[STEPS];
    struct ls_lights_status status;
    struct ls_diag diag = {0};
    struct ls_program program = program_of(steps);
    must(ls_lights_load(lights, &program, NULL, &diag), &diag);
    must(ls_lights_arm(lights, &diag), &diag);
    must(ls_lights_grant(lights, STEPS, &diag), &diag);
    gint64 limit = g_get_monotonic_time() + 10 * G_USEC_PER_SEC;
    for (size_t n = 0, got; n < STEPS; n += got) {
        must(ls_lights_poll(lights, &status, events + n, STEPS - n, &got, &diag), &diag);
        g_assert_cmpint(g_get_monotonic_time(), <, limit);
    }
    for (uint32_t i = 0; i < STEPS; i++)
        g_assert_cmpuint(events[i].step, ==, i);
    g_assert_cmpuint(status.events_lost, ==, 0);
}

static void run_with(enum sim_controller_wire wire, struct sim_controller_fault fault)
{
    struct sim_controller_config config = with_fault(wire, fault);
    struct dome dome = dome_start(&config);
    struct ls_lights_config address = dome_address(&dome);
    struct ls_lights *lights;
    struct ls_diag diag = {0};
    must(ls_lights_open(&address, &lights, &diag), &diag);
    fire(lights);
    ls_lights_close(lights);
    dome_stop(&dome);
}

static void read_status(struct ls_link *link, uint16_t regs[LS_WIRE_STATUS_SIZE])
{
    struct ls_diag diag = {0};
    must(link->ops->read(link, LS_WIRE_STATUS, LS_WIRE_STATUS_SIZE, regs, &diag), &diag);
}

/** Fire STEPS steps and give their events time to come in packets, without a look at the status
 * block's: 10 s until the controller has them all, and three requests more: the first brings back
 * the packets sent by then and lets the transfers fly again for the rest. */
static void fire_unread(struct ls_dome *dome, struct ls_link *link, uint16_t *regs)
{
    struct ls_step steps[STEPS];
    struct ls_program program = program_of(steps);
    struct ls_diag diag = {0};
    must(ls_dome_load(dome, &program, NULL, &diag), &diag);
    must(ls_dome_arm(dome, &diag), &diag);
    gint64 limit = g_get_monotonic_time() + 10 * G_USEC_PER_SEC;
    do {
        must(ls_dome_grant(dome, STEPS, &diag), &diag); /* a sign of life, too */
        read_status(link, regs);
        g_assert_cmpint(g_get_monotonic_time(), <, limit);
    } while (regs[LS_WIRE_ST_EVENT_PENDING] != STEPS);
    for (int i = 0; i < 3; i++)
        read_status(link, regs);
}

/** Which of STEPS events come in packets? */
static void take_packets(struct sim_controller_fault fault, bool came[STEPS])
{
    struct sim_controller_config config = with_fault(SIM_WIRE_USB, fault);
    struct dome stand = dome_start(&config);
    struct ls_lights_config address = dome_address(&stand);
    uint16_t regs[LS_WIRE_STATUS_SIZE], record[LS_WIRE_EVENT_SIZE];
    struct ls_link *link;
    struct ls_dome *dome;
    struct ls_diag diag = {0};
    must(ls_wire_usb.create(&address, &link, &diag), &diag);
    must(ls_dome_open(link, &dome, &diag), &diag);
    fire_unread(dome, link, regs);
    uint32_t boot = ls_wire_get32(regs + LS_WIRE_ST_BOOT);
    for (uint32_t i = 0; i < STEPS; i++) {
        came[i] = link->ops->take_event(link, boot, regs[LS_WIRE_ST_ARM], i, record);
        if (came[i])
            g_assert_cmpuint(ls_wire_get32(record + LS_WIRE_EV_STEP), ==, i);
    }
    ls_dome_close(dome);
    dome_stop(&stand);
}

/** Of five packets, each with one record at least; the first of them from step 10 on. */
static void five_are_missing(const bool came[STEPS])
{
    unsigned missing = 0;
    for (int i = 0; i < STEPS; i++) {
        g_assert_true(came[i] || i >= 10);
        missing += !came[i];
    }
    g_assert_cmpuint(missing, >=, 5);
}

static void test_lost_packets(void)
{
    struct sim_controller_fault fault = {SIM_CONTROLLER_LOSE_PACKET, 10, 5, 0};
    bool came[STEPS];
    take_packets(fault, came);
    five_are_missing(came);
    run_with(SIM_WIRE_USB, fault);
}

static void test_damaged_packets(void)
{
    struct sim_controller_fault fault = {SIM_CONTROLLER_DAMAGE_PACKET, 10, 5, 0};
    bool came[STEPS];
    take_packets(fault, came);
    five_are_missing(came);
    run_with(SIM_WIRE_USB, fault);
}

static void test_halt(void)
{
    struct sim_controller_fault fault = {SIM_CONTROLLER_HALT, 20, 1, 0};
    bool came[STEPS];
    host.cleared = 0;
    take_packets(fault, came);
    unsigned cleared = host.cleared;
    /* one stall; of the eight transfers under way each may come back with it after it was cleared
     */
    g_assert_cmpuint(cleared, >=, 1);
    g_assert_cmpuint(cleared, <=, 8);
    for (int i = 0; i < STEPS; i++)
        g_assert_true(came[i]);
    run_with(SIM_WIRE_USB, fault);
    g_assert_cmpuint(host.cleared, >, cleared);
}

/** A packet longer than its transfer is lost with its events, which come with the status block. */
static void test_overflow(void)
{
    struct sim_controller_config config = dome_small();
    config.wire = SIM_WIRE_USB;
    struct dome dome = dome_start(&config);
    struct ls_lights_config address = dome_address(&dome);
    struct ls_lights *lights;
    struct ls_diag diag = {0};
    host.overflowed = 0;
    host.to_shorten = 5;
    must(ls_lights_open(&address, &lights, &diag), &diag);
    fire(lights);
    g_assert_cmpuint(host.overflowed, ==, 5);
    ls_lights_close(lights);
    dome_stop(&dome);
}

/** Fire one step, after which the controller fails, and poll until that is noticed: what is said
 * then. *lights stays open: (transfer full). */
static enum ls_err poll_until_lost(const struct dome *dome, const char *serial,
                                   struct ls_lights **lights, struct ls_diag *diag)
{
    struct ls_lights_config address = dome_address(dome);
    struct ls_lights_status status;
    struct ls_step step = {.pulse_us = 100};
    struct ls_program program = {&condition, 1, &step, 1, 1000};
    enum ls_err err;
    gint64 start;
    size_t n;
    address.timeout_ms = 100;
    address.address = serial;
    must(ls_lights_open(&address, lights, diag), diag);
    must(ls_lights_load(*lights, &program, NULL, diag), diag);
    must(ls_lights_arm(*lights, diag), diag);
    must(ls_lights_grant(*lights, 1, diag), diag);
    do {
        start = g_get_monotonic_time();
        err = ls_lights_poll(*lights, &status, NULL, 0, &n, diag);
    } while (!err);
    /* five timeouts at most, by the contract of lights.h, and scheduling */
    g_assert_cmpint(g_get_monotonic_time() - start, <, 700000);
    return err;
}

static void test_unplugged(void)
{
    struct sim_controller_config config =
        with_fault(SIM_WIRE_USB, (struct sim_controller_fault){SIM_CONTROLLER_DISCONNECT, 0, 1, 0});
    struct dome dome = dome_start(&config);
    struct ls_lights *lights;
    struct ls_diag diag = {0};
    g_assert_cmpint(poll_until_lost(&dome, "any", &lights, &diag), ==, LS_ERR_GONE);
    g_assert_nonnull(strstr(diag.text, "not plugged in"));
    g_assert_cmpint(ls_lights_blank(lights, &diag), ==, LS_ERR_GONE);
    ls_lights_close(lights);
    dome_stop(&dome);
}

/** It stops answering: opening it again asks for its serial number, under the same timeout. */
static void test_mute_by_serial(void)
{
    struct sim_controller_config config =
        with_fault(SIM_WIRE_USB, (struct sim_controller_fault){SIM_CONTROLLER_DEAD, 0, 1, 0});
    struct dome dome = dome_start(&config);
    struct ls_lights *lights;
    struct ls_diag diag = {0};
    g_assert_cmpint(poll_until_lost(&dome, config.serial, &lights, &diag), ==, LS_ERR_TIMEOUT);
    g_assert_nonnull(strstr(diag.text, "serial numbers: no answer within 100 ms"));
    ls_lights_close(lights);
    dome_stop(&dome);
}

static void test_serial_number(void)
{
    struct sim_controller_config config = dome_small();
    config.wire = SIM_WIRE_USB;
    struct dome dome = dome_start(&config);
    struct ls_lights_config address = dome_address(&dome);
    struct ls_lights *lights;
    struct ls_diag diag = {0};
    address.timeout_ms = 50;
    address.address = "LS-DOME-SIM-0002";
    g_assert_cmpint(ls_lights_open(&address, &lights, &diag), ==, LS_ERR_GONE);
    g_assert_nonnull(strstr(diag.text, "LS-DOME-SIM-0002"));
    address.address = config.serial;
    must(ls_lights_open(&address, &lights, &diag), &diag);
    g_assert_cmpstr(ls_lights_info(lights)->serial, ==, config.serial);
    ls_lights_close(lights);
    dome_stop(&dome);
}

static enum ls_err refuse_permission(struct ls_link *link, struct ls_diag *diag)
{
    (void)link;
    return ls_fail(diag, LS_ERR_REFUSED, "no permission");
}

static void test_refused_by_the_host(void)
{
    struct sim_controller_config config = dome_small();
    struct dome stand = dome_start(&config);
    struct ls_lights_config address = dome_address(&stand);
    struct ls_link *link;
    struct ls_dome *dome;
    struct ls_diag diag = {0};
    must(ls_wire_modbus.create(&address, &link, &diag), &diag);
    must(ls_dome_open(link, &dome, &diag), &diag);
    struct ls_link_ops ops = *link->ops;
    ops.connect = refuse_permission;
    link->ops = &ops;
    ops.disconnect(link);
    g_assert_cmpint(ls_dome_grant(dome, 1, &diag), ==, LS_ERR_REFUSED);
    g_assert_cmpstr(diag.text, ==, "no permission");
    ls_dome_close(dome);
    dome_stop(&stand);
}

/** An answer that comes after its timeout must not pass for the answer to the next question:
 * statuses would be old, and acknowledged events read twice. */
static void test_late_answers(void)
{
    struct sim_controller_config config = with_fault(
        SIM_WIRE_MODBUS_RTU, (struct sim_controller_fault){SIM_CONTROLLER_LATE, 10, 1, 150});
    struct dome dome = dome_start(&config);
    struct ls_lights_config address = dome_address(&dome);
    struct ls_lights *lights;
    struct ls_diag diag = {0};
    address.timeout_ms = 100;
    must(ls_lights_open(&address, &lights, &diag), &diag);
    fire(lights);
    ls_lights_close(lights);
    dome_stop(&dome);
}

/* Somebody asked before us and died: its answer lies there. */
static void test_answer_to_another(void)
{
    static const uint8_t ask[] = {1, 3, 0, 0, 0, 8, 0x44, 0x0c}; /* the identity's first 8 */
    struct sim_controller_config config = dome_small();
    config.wire = SIM_WIRE_MODBUS_RTU;
    struct dome dome = dome_start(&config);
    struct ls_lights_config address = dome_address(&dome);
    struct ls_lights *lights;
    struct ls_diag diag = {0};
    int line = open(address.address, O_RDWR | O_NOCTTY);
    struct pollfd answered = {.fd = line, .events = POLLIN};
    g_assert_cmpint(write(line, ask, sizeof ask), ==, sizeof ask);
    g_assert_cmpint(poll(&answered, 1, 10000), ==, 1);
    close(line);
    must(ls_lights_open(&address, &lights, &diag), &diag);
    fire(lights);
    ls_lights_close(lights);
    dome_stop(&dome);
}

static void test_damaged_answers(void)
{
    run_with(SIM_WIRE_MODBUS_RTU,
             (struct sim_controller_fault){SIM_CONTROLLER_DAMAGE_ANSWER, 10, 1, 0});
}

static void test_baud(void)
{
    struct ls_lights_config address = {
        .driver = "modbus-rtu", .address = "/dev/null", .unit = 1, .baud = 12345};
    struct ls_lights *lights;
    struct ls_diag diag = {0};
    g_assert_cmpint(ls_lights_open(&address, &lights, &diag), ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, "12345"));
    address.baud = 9600;
    address.timeout_ms = 100;
    g_assert_cmpint(ls_lights_open(&address, &lights, &diag), ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, "at least"));
    address.timeout_ms = 1000;
    address.address = "/nonexistent";
    g_assert_cmpint(ls_lights_open(&address, &lights, &diag), ==, LS_ERR_GONE);
}

static size_t packet_of(uint32_t first, uint16_t n, uint8_t *bytes)
{
    uint16_t regs[LS_WIRE_PACKET_MAX] = {
        [LS_WIRE_PK_MAGIC] = LS_WIRE_PACKET_MAGIC, [LS_WIRE_PK_ARM] = 7, [LS_WIRE_PK_COUNT] = n};
    size_t used = LS_WIRE_PK_HEADER + n * LS_WIRE_EVENT_SIZE;
    ls_wire_put32(regs + LS_WIRE_PK_BOOT, BOOT);
    ls_wire_put32(regs + LS_WIRE_PK_FIRST, first);
    for (uint32_t i = 0; i < n; i++)
        ls_wire_put32(regs + LS_WIRE_PK_HEADER + i * LS_WIRE_EVENT_SIZE, first + i);
    ls_wire_put32(regs + used, ls_wire_crc32c(regs, used));
    ls_wire_put_registers(regs, used + 2, bytes);
    return 2 * (used + 2);
}

static void test_every_flipped_bit(void)
{
    static struct ls_event_queue queue;
    uint8_t bytes[LS_WIRE_USB_PACKET_BYTES];
    uint16_t record[LS_WIRE_EVENT_SIZE];
    size_t n = packet_of(5, 3, bytes);
    for (size_t bit = 0; bit < 8 * n; bit++) {
        bytes[bit / 8] ^= (uint8_t)(1 << bit % 8);
        g_assert_false(ls_event_queue_receive(&queue, bytes, n));
        bytes[bit / 8] ^= (uint8_t)(1 << bit % 8);
    }
    for (size_t shorter = 0; shorter < n; shorter++)
        g_assert_false(ls_event_queue_receive(&queue, bytes, shorter));
    g_assert_cmpuint(queue.tail, ==, 0);
    g_assert_true(ls_event_queue_receive(&queue, bytes, n));
    g_assert_false(ls_event_queue_take(&queue, BOOT, 7, 4, record)); /* a gap: 4 is missing */
    g_assert_true(ls_event_queue_take(&queue, BOOT, 7, 6, record));  /* 5 came otherwise */
    g_assert_cmpuint(ls_wire_get32(record), ==, 6);
    g_assert_false(ls_event_queue_take(&queue, BOOT, 8, 7, record)); /* of another arm */
    g_assert_cmpuint(queue.head, ==, queue.tail);
}

static void test_another_power_up(void)
{
    static struct ls_event_queue queue;
    uint8_t bytes[LS_WIRE_USB_PACKET_BYTES];
    uint16_t record[LS_WIRE_EVENT_SIZE];
    g_assert_true(ls_event_queue_receive(&queue, bytes, packet_of(0, 3, bytes)));
    g_assert_false(ls_event_queue_take(&queue, BOOT + 1, 7, 0, record));
    g_assert_cmpuint(queue.head, ==, queue.tail);
}

static void test_full_queue(void)
{
    static struct ls_event_queue queue;
    uint8_t bytes[LS_WIRE_USB_PACKET_BYTES];
    uint16_t record[LS_WIRE_EVENT_SIZE];
    for (uint32_t first = 0; first < 2 * LS_EVENT_QUEUE; first += LS_WIRE_PK_RECORDS)
        g_assert_true(
            ls_event_queue_receive(&queue, bytes, packet_of(first, LS_WIRE_PK_RECORDS, bytes)));
    for (uint32_t i = 0; i < LS_EVENT_QUEUE; i++)
        g_assert_true(ls_event_queue_take(&queue, BOOT, 7, i, record));
    g_assert_false(ls_event_queue_take(&queue, BOOT, 7, LS_EVENT_QUEUE, record));
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/wires/usb/lost-packets-lose-no-event", test_lost_packets);
    g_test_add_func("/wires/usb/damaged-packets-lose-no-event", test_damaged_packets);
    g_test_add_func("/wires/usb/a-stalled-endpoint-is-cleared", test_halt);
    g_test_add_func("/wires/usb/packets-too-long-lose-no-event", test_overflow);
    g_test_add_func("/wires/usb/a-pulled-plug-is-gone-in-bounds", test_unplugged);
    g_test_add_func("/wires/usb/a-mute-controller-of-a-serial-number-times-out",
                    test_mute_by_serial);
    g_test_add_func("/wires/usb/the-serial-number-chooses", test_serial_number);
    g_test_add_func("/wires/usb/every-flipped-bit-of-a-packet-is-caught", test_every_flipped_bit);
    g_test_add_func("/wires/usb/records-of-another-power-up-are-dropped", test_another_power_up);
    g_test_add_func("/wires/usb/a-full-queue-keeps-what-came-first", test_full_queue);
    g_test_add_func("/wires/a-refused-reconnection-says-why", test_refused_by_the_host);
    g_test_add_func("/wires/rtu/a-late-answer-is-no-answer-to-the-next", test_late_answers);
    g_test_add_func("/wires/rtu/an-answer-to-another-is-let-pass", test_answer_to_another);
    g_test_add_func("/wires/rtu/a-damaged-answer-is-asked-for-again", test_damaged_answers);
    g_test_add_func("/wires/rtu/rates-and-timeouts-that-cannot-work-are-refused", test_baud);
    return g_test_run();
}
