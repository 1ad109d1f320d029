#include "sim/usb_device.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

enum { SETUP = 8, GET_DESCRIPTOR = 6, DEVICE = 1, CONFIGURATION = 2, STRING = 3 };
enum { PRODUCT_NAME = 1, SERIAL_NUMBER = 2, INTERVAL_1_MS = 4 };

#define LITTLE(x) (uint8_t)(x), (uint8_t)((x) >> 8)

static const uint8_t device_descriptor[] = {
    18,
    DEVICE,
    LITTLE(0x0200), /* USB 2 */
    0xff,
    0,
    0,
    64, /* class of the vendor's, 64 bytes on endpoint 0 */
    LITTLE(LS_WIRE_USB_VENDOR),
    LITTLE(LS_WIRE_USB_PRODUCT),
    LITTLE(0x0100),
    0,
    PRODUCT_NAME,
    SERIAL_NUMBER,
    1,
};

static const uint8_t configuration_descriptor[] = {
    9,
    CONFIGURATION,
    LITTLE(25),
    1,
    1,
    0,
    0xc0,
    1, /* one interface, own power */
    9,
    4,
    LS_WIRE_USB_INTERFACE,
    0,
    1,
    0xff,
    0,
    0,
    0, /* one endpoint: */
    7,
    5,
    LS_WIRE_USB_EVENTS,
    3,
    LITTLE(LS_WIRE_USB_PACKET_BYTES),
    INTERVAL_1_MS,
};

static int give(const uint8_t *from, size_t n, uint8_t *to, int most)
{
    int given = (int)n < most ? (int)n : most;
    memcpy(to, from, (size_t)given);
    return given;
}

static int give_string(const struct sim_controller *c, unsigned index, uint8_t *to, int most)
{
    uint8_t descriptor[2 + 2 * 63] = {4, STRING, LITTLE(0x0409)}; /* index 0: English */
    const char *text = index == SERIAL_NUMBER ? c->config.serial : "LED dome controller";
    for (size_t i = 0; index && i <= strlen(text); i++) {
        descriptor[0] = (uint8_t)(2 + 2 * i);
        if (text[i]) {
            descriptor[2 + 2 * i] = (uint8_t)text[i];
            descriptor[3 + 2 * i] = 0;
        }
    }
    return give(descriptor, descriptor[0], to, most);
}

static int describe(const struct sim_controller *c, unsigned value, uint8_t *to, int most,
                    int *status)
{
    unsigned kind = value >> 8, index = value & 255;
    if (kind == DEVICE)
        return give(device_descriptor, sizeof device_descriptor, to, most);
    if (kind == CONFIGURATION)
        return give(configuration_descriptor, sizeof configuration_descriptor, to, most);
    if (kind == STRING && index <= SERIAL_NUMBER)
        return give_string(c, index, to, most);
    *status = -EPIPE;
    return 0;
}

static int registers(struct sim_controller *c, const uint8_t *setup, uint8_t *data, int n,
                     int *status)
{
    uint16_t regs[SIM_MAX_REGISTERS];
    unsigned address = setup[4] | setup[5] << 8, count = (unsigned)n / 2;
    int rc = SIM_ANSWER_VALUE;
    if (n % 2 == 0 && count >= 1 && count <= SIM_MAX_REGISTERS && setup[1] == LS_WIRE_USB_WRITE) {
        ls_wire_get_registers(data, count, regs);
        rc = sim_controller_write(c, address, regs, count);
    } else if (n % 2 == 0 && count >= 1 && count <= SIM_MAX_REGISTERS) {
        rc = sim_controller_read(c, address, regs, count);
        if (!rc)
            ls_wire_put_registers(regs, count, data);
    }
    *status = rc ? -EPIPE : 0;
    return rc ? 0 : n;
}

int sim_usb_control(struct sim_controller *c, uint8_t *setup, int size, int *status)
{
    int n = size >= SETUP ? setup[6] | setup[7] << 8 : 0;
    unsigned value = size >= SETUP ? setup[2] | (unsigned)setup[3] << 8 : 0;
    *status = -EPIPE;
    if (size < SETUP || n > size - SETUP)
        return 0;
    *status = 0;
    if (setup[0] == 0x80 && setup[1] == GET_DESCRIPTOR)
        return describe(c, value, setup + SETUP, n, status);
    if ((setup[0] == 0xc0 && setup[1] == LS_WIRE_USB_READ) ||
        (setup[0] == 0x40 && setup[1] == LS_WIRE_USB_WRITE))
        return registers(c, setup, setup + SETUP, n, status);
    *status = -EPIPE;
    return 0;
}

size_t sim_usb_packet(const struct sim_controller *c, uint32_t first, uint16_t sequence,
                      uint8_t bytes[LS_WIRE_USB_PACKET_BYTES], uint32_t *next)
{
    uint16_t regs[LS_WIRE_PACKET_MAX] = {0};
    uint32_t n = c->event_next - first;
    n = n < LS_WIRE_PK_RECORDS ? n : LS_WIRE_PK_RECORDS;
    regs[LS_WIRE_PK_MAGIC] = LS_WIRE_PACKET_MAGIC;
    regs[LS_WIRE_PK_SEQUENCE] = sequence;
    ls_wire_put32(regs + LS_WIRE_PK_BOOT, c->boot);
    regs[LS_WIRE_PK_ARM] = c->arm;
    regs[LS_WIRE_PK_COUNT] = (uint16_t)n;
    ls_wire_put32(regs + LS_WIRE_PK_FIRST, first);
    for (uint32_t i = 0; i < n; i++)
        sim_controller_event(c, first + i, regs + LS_WIRE_PK_HEADER + i * LS_WIRE_EVENT_SIZE);
    size_t used = LS_WIRE_PK_HEADER + n * LS_WIRE_EVENT_SIZE;
    ls_wire_put32(regs + used, ls_wire_crc32c(regs, used));
    ls_wire_put_registers(regs, used + 2, bytes);
    *next = first + n;
    return 2 * (used + 2);
}

void sim_usb_describe(int number, char *text, size_t size)
{
    int n = snprintf(
        text, size,
        "P: /devices/usb1/1-%d\nE: SUBSYSTEM=usb\n"
        "E: DRIVER=usb\nE: BUSNUM=001\nE: DEVNUM=%03d\nE: DEVNAME=/dev/bus/usb/001/%03d\n"
        "E: DEVTYPE=usb_device\nE: MAJOR=189\nE: MINOR=%d\nA: bConfigurationValue=1\\n\n"
        "A: busnum=1\\n\nA: devnum=%d\\n\nA: speed=480\\n\nA: idVendor=%04x\\n\n"
        "A: idProduct=%04x\\n\nH: descriptors=",
        number, number, number, number - 1, number, LS_WIRE_USB_VENDOR, LS_WIRE_USB_PRODUCT);
    for (size_t i = 0; i < sizeof device_descriptor; i++)
        n += snprintf(text + n, size - (size_t)n, "%02x", device_descriptor[i]);
    for (size_t i = 0; i < sizeof configuration_descriptor; i++)
        n += snprintf(text + n, size - (size_t)n, "%02x", configuration_descriptor[i]);
    snprintf(text + n, size - (size_t)n, "\n");
}
