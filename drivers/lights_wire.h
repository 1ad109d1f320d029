/*
 * lights_wire: the constants of the controller contract, shared by every driver and the simulator.
 * Layer: drivers (includes nothing of ours; sim may include it). Threads: any; pure.
 * The contract itself, in prose and register by register: drivers/modbus/README.md.
 *
 * Everything is built of 16-bit registers. A 32-bit number is two registers, a 64-bit number four,
 * most significant register first. Register k of the program image is bytes 2k (high), 2k + 1.
 * Addresses are PDU addresses, counted from 0.
 */
#ifndef LS_DRIVERS_LIGHTS_WIRE_H
#define LS_DRIVERS_LIGHTS_WIRE_H

#include <stddef.h>
#include <stdint.h>

enum {
    LS_WIRE_CONTRACT = 1, /* version of this contract */
    LS_WIRE_MAGIC_0 = 0x4c53,
    LS_WIRE_MAGIC_1 = 0x4443, /* "LSDC" */
};

/** Identity block, read only. */
enum {
    LS_WIRE_IDENTITY = 0x0000,
    LS_WIRE_ID_MAGIC = 0,    /* 2 registers */
    LS_WIRE_ID_CONTRACT = 2, /* 1 */
    LS_WIRE_ID_FIRMWARE = 4, /* 2 */
    LS_WIRE_ID_BOOT = 6,     /* 2: changes at every power-up, never 0 */
    LS_WIRE_ID_SERIAL = 8,   /* 16: 32 bytes of ASCII, NUL padded */
    LS_WIRE_IDENTITY_SIZE = 24,
};

/** Limits block, read only; every entry is 32 bit. */
enum {
    LS_WIRE_LIMITS = 0x0040,
    LS_WIRE_LIM_LIGHTS = 0,
    LS_WIRE_LIM_CHANNELS = 2,
    LS_WIRE_LIM_PWM_PERIOD_US = 4,
    LS_WIRE_LIM_PWM_LEVELS = 6,
    LS_WIRE_LIM_MIN_PULSE_US = 8,
    LS_WIRE_LIM_MAX_PULSE_US = 10,
    LS_WIRE_LIM_MIN_PERIOD_US = 12,
    LS_WIRE_LIM_DUTY_PERMILLE = 14,
    LS_WIRE_LIM_CURRENT_MA = 16,
    LS_WIRE_LIM_LED_CURRENT_MA = 18,
    LS_WIRE_LIM_CONDITIONS = 20,
    LS_WIRE_LIM_STEPS = 22,
    LS_WIRE_LIM_PROGRAM_BYTES = 24,
    LS_WIRE_LIM_HOLD_US = 26,
    LS_WIRE_LIM_HEARTBEAT_MS = 28,
    LS_WIRE_LIM_POWER_MW = 30,     /* of the whole dome, mean over a second */
    LS_WIRE_LIM_LED_POWER_MW = 32, /* of one LED group at full level */
    LS_WIRE_LIM_HOT_C = 34,        /* from here on flagged as hot */
    LS_WIRE_LIM_MAX_C = 36,        /* here over-temperature latches */
    LS_WIRE_LIMITS_SIZE = 38,
};

/** Status block, read only; one read is one moment, the events behind it included. */
enum {
    LS_WIRE_STATUS = 0x0100,
    LS_WIRE_ST_STATE = 0,
    LS_WIRE_ST_FAULTS = 1,
    LS_WIRE_ST_FLAGS = 2,
    LS_WIRE_ST_TEMPERATURE = 3,    /* signed, degrees Celsius */
    LS_WIRE_ST_BOOT = 4,           /* 2: as in the identity */
    LS_WIRE_ST_ARM = 6,            /* 1: counts arms since power-up, wraps */
    LS_WIRE_ST_PROGRESS = 7,       /* 1: of the preparation, permille */
    LS_WIRE_ST_NOW_US = 8,         /* 4: controller clock */
    LS_WIRE_ST_FIRED = 12,         /* 2: pulses started since arm */
    LS_WIRE_ST_GRANTED = 14,       /* 2 */
    LS_WIRE_ST_MISSED = 16,        /* 2 */
    LS_WIRE_ST_EVENTS_LOST = 18,   /* 2: since arm */
    LS_WIRE_ST_REFUSAL = 20,       /* 1: why the last refused request was refused */
    LS_WIRE_ST_DETAIL = 22,        /* 2: index the refusal is about */
    LS_WIRE_ST_PROGRAM_CRC = 24,   /* 2: of the committed program, 0 if none */
    LS_WIRE_ST_EVENT_FIRST = 26,   /* 2: sequence number of the first event below */
    LS_WIRE_ST_EVENT_COUNT = 28,   /* 1: events below, [0, LS_WIRE_EVENTS_PER_READ] */
    LS_WIRE_ST_EVENT_PENDING = 29, /* 1: events in the queue, those below included */
    LS_WIRE_ST_EVENTS = 30,        /* LS_WIRE_EVENTS_PER_READ records */
    LS_WIRE_EVENTS_PER_READ = 9,
    LS_WIRE_STATUS_SIZE = 120,
};

/** One event record. */
enum {
    LS_WIRE_EV_STEP = 0,     /* 2 */
    LS_WIRE_EV_US = 2,       /* 4: start of the pulse */
    LS_WIRE_EV_WIDTH_US = 6, /* 2 */
    LS_WIRE_EV_FLAGS = 8,    /* 1 */
    LS_WIRE_EV_SEQUENCE = 9, /* 1: low half of the sequence number */
    LS_WIRE_EVENT_SIZE = 10,
};

/** Control block, write (read returns the last value written). Any accepted write into it is a
 * sign of life from the host. */
enum {
    LS_WIRE_CONTROL = 0x0200,
    LS_WIRE_CT_COMMAND = 0,     /* 1: enum ls_wire_command */
    LS_WIRE_CT_GRANT = 2,       /* 2: steps [0, value) since arm may fire; a larger value than
                                  before releases a held step, the same one does nothing */
    LS_WIRE_CT_ACK = 4,         /* 2: events with smaller sequence numbers have been read */
    LS_WIRE_CT_WORK = 6,        /* 2: channel and level of the work light; level 0: none */
    LS_WIRE_CT_BYTES = 8,       /* 2: size of the program image */
    LS_WIRE_CT_CRC = 10,        /* 2: its CRC-32C as the host computed it */
    LS_WIRE_CT_CONDITIONS = 12, /* 2 */
    LS_WIRE_CT_STEPS = 14,      /* 2 */
    LS_WIRE_CONTROL_SIZE = 16,
    /* read only: CRC-32C of the first CT_BYTES bytes of program memory as it stands */
    LS_WIRE_IMAGE_CRC = 0x0220,
    LS_WIRE_IMAGE_CRC_SIZE = 2,
};

/** Window onto program memory. A write starts at WN_ADDRESS and carries exactly 3 + length
 * registers; a read returns the memory at the address written last. */
enum {
    LS_WIRE_WINDOW = 0x0300,
    LS_WIRE_WN_ADDRESS = 0, /* 2: in registers from the start of program memory */
    LS_WIRE_WN_LENGTH = 2,  /* 1 */
    LS_WIRE_WN_DATA = 3,
    LS_WIRE_WINDOW_DATA = 120, /* registers of data at most */
    LS_WIRE_WINDOW_SIZE = 123,
};

enum ls_wire_command {
    LS_WIRE_COMMIT = 1, /* check the image against CT_*, then get ready */
    LS_WIRE_ARM = 2,
    LS_WIRE_BLANK = 3,        /* always accepted; the work light goes out too */
    LS_WIRE_CLEAR_FAULTS = 4, /* refused while a cause persists */
    LS_WIRE_RELEASE = 5,      /* of a held step */
    LS_WIRE_ALIVE = 6,        /* sign of life, nothing else */
    LS_WIRE_WORK = 7,         /* show the work light */
    LS_WIRE_STEADY = 8,       /* the same, as long as there are signs of life */
};

enum ls_wire_state {
    LS_WIRE_IDLE = 0,   /* no committed program */
    LS_WIRE_LOADED = 1, /* committed and ready */
    LS_WIRE_ARMED = 2,
    LS_WIRE_DONE = 3,
    LS_WIRE_FAULT = 4,
    LS_WIRE_PREPARING = 5, /* committed, not ready yet */
};

/** Fault bits; latched until cleared. */
enum ls_wire_fault {
    LS_WIRE_FAULT_INTERLOCK = 1 << 0,
    LS_WIRE_FAULT_ESTOP = 1 << 1,
    LS_WIRE_FAULT_OVERTEMP = 1 << 2,
    LS_WIRE_FAULT_OVERCURRENT = 1 << 3,
    LS_WIRE_FAULT_OVERDUTY = 1 << 4,
    LS_WIRE_FAULT_HEARTBEAT = 1 << 5,
    LS_WIRE_FAULT_PROGRAM = 1 << 6,
    LS_WIRE_FAULT_OVERPOWER = 1 << 7,
};

/** Flags of the status block: what is so at this moment. */
enum ls_wire_flag {
    LS_WIRE_FLAG_LIT = 1 << 0,     /* by a step */
    LS_WIRE_FLAG_HOLDING = 1 << 1, /* step FIRED - 1 is lit and held */
    LS_WIRE_FLAG_INTERLOCK_OPEN = 1 << 2,
    LS_WIRE_FLAG_ESTOP_PRESSED = 1 << 3,
    LS_WIRE_FLAG_HOT = 1 << 4,
    LS_WIRE_FLAG_WORK = 1 << 5, /* the work light is on */
};

enum ls_wire_refusal {
    LS_WIRE_REFUSED_NOT = 0,
    LS_WIRE_REFUSED_STATE = 1,      /* not in this state; detail: state */
    LS_WIRE_REFUSED_FAULT = 2,      /* a fault is latched; detail: fault bits */
    LS_WIRE_REFUSED_VALUE = 3,      /* unknown command, grant beyond the program, window shape */
    LS_WIRE_REFUSED_CRC = 4,        /* detail: CRC found */
    LS_WIRE_REFUSED_COUNTS = 5,     /* image header disagrees with CT_*, or over capacity */
    LS_WIRE_REFUSED_FORMAT = 6,     /* detail: register offset in the image */
    LS_WIRE_REFUSED_LIGHT = 7,      /* light out of range; detail: condition */
    LS_WIRE_REFUSED_CHANNEL = 8,    /* detail: condition */
    LS_WIRE_REFUSED_CURRENT = 9,    /* detail: condition; latches OVERCURRENT */
    LS_WIRE_REFUSED_CONDITION = 10, /* step of an unknown condition; detail: step */
    LS_WIRE_REFUSED_PULSE = 11,     /* detail: step; as all below, latches PROGRAM */
    LS_WIRE_REFUSED_PWM = 12,       /* dimmed pulse is no multiple of the PWM period; step */
    LS_WIRE_REFUSED_PERIOD = 13,
    LS_WIRE_REFUSED_DUTY = 14,       /* detail: step; latches OVERDUTY */
    LS_WIRE_REFUSED_UNPREPARED = 15, /* the preparation failed */
    LS_WIRE_REFUSED_POWER = 16,      /* detail: step; latches OVERPOWER */
};

/** Program image: header, n_conditions condition records, n_steps step records. */
enum {
    LS_WIRE_IM_MAGIC = 0,      /* 1 */
    LS_WIRE_IM_CONTRACT = 1,   /* 1 */
    LS_WIRE_IM_CONDITIONS = 2, /* 2 */
    LS_WIRE_IM_STEPS = 4,      /* 2 */
    LS_WIRE_IM_PERIOD_US = 6,  /* 2 */
    LS_WIRE_IM_SIZE = 8,
    LS_WIRE_IMAGE_MAGIC = 0x4c50, /* "LP" */
};

/** First register of a condition record; then, a register each: */
enum ls_wire_condition {
    LS_WIRE_CONDITION_DARK = 0,    /* nothing */
    LS_WIRE_CONDITION_ONE = 1,     /* light, channel, level */
    LS_WIRE_CONDITION_SPHERE = 2,  /* channel, level: every light */
    LS_WIRE_CONDITION_SEGMENT = 3, /* n, channel, level, n x light */
    LS_WIRE_CONDITION_LIST = 4,    /* n, n x (light, channel, level) */
};

/** Step record. */
enum {
    LS_WIRE_STEP_CONDITION = 0, /* 1 */
    LS_WIRE_STEP_FLAGS = 1,     /* 1 */
    LS_WIRE_STEP_PULSE_US = 2,  /* 2 */
    LS_WIRE_STEP_SETTLE_US = 4, /* 2 */
    LS_WIRE_STEP_SIZE = 6,
};

enum ls_wire_step_flag { LS_WIRE_STEP_HOLD = 1 << 0 };
enum ls_wire_event_flag { LS_WIRE_EVENT_LATE = 1 << 0, LS_WIRE_EVENT_CLIPPED = 1 << 1 };

/** USB: what it is found by, and how registers travel; drivers/usb/README.md. */
enum {
    LS_WIRE_USB_VENDOR = 0x1209, /* pid.codes, and a product number it sets aside for prototypes */
    LS_WIRE_USB_PRODUCT = 0x0001,
    LS_WIRE_USB_INTERFACE = 0,
    LS_WIRE_USB_READ = 1,      /* vendor request, device to host: wIndex register, wLength bytes */
    LS_WIRE_USB_WRITE = 2,     /* the same, host to device */
    LS_WIRE_USB_EVENTS = 0x81, /* interrupt endpoint */
    LS_WIRE_USB_PACKET_BYTES = 512, /* largest packet of it */
};

/** Event packet: header, records, CRC-32C (2) of all registers before it. */
enum {
    LS_WIRE_PK_MAGIC = 0,    /* 1 */
    LS_WIRE_PK_SEQUENCE = 1, /* 1: counts packets since power-up, wraps */
    LS_WIRE_PK_BOOT = 2,     /* 2 */
    LS_WIRE_PK_ARM = 4,      /* 1 */
    LS_WIRE_PK_COUNT = 5,    /* 1: records, [1, LS_WIRE_PK_RECORDS] */
    LS_WIRE_PK_FIRST = 6,    /* 2: sequence number of the first record */
    LS_WIRE_PK_HEADER = 8,
    LS_WIRE_PK_RECORDS = 24,
    LS_WIRE_PACKET_MAGIC = 0x4c45, /* "LE" */
    LS_WIRE_PACKET_MAX = LS_WIRE_PK_HEADER + LS_WIRE_PK_RECORDS * LS_WIRE_EVENT_SIZE + 2,
};

static inline void ls_wire_put32(uint16_t *reg, uint32_t value)
{
    reg[0] = (uint16_t)(value >> 16);
    reg[1] = (uint16_t)value;
}

static inline uint32_t ls_wire_get32(const uint16_t *reg)
{
    return (uint32_t)reg[0] << 16 | reg[1];
}

static inline void ls_wire_put64(uint16_t *reg, uint64_t value)
{
    ls_wire_put32(reg, (uint32_t)(value >> 32));
    ls_wire_put32(reg + 2, (uint32_t)value);
}

static inline uint64_t ls_wire_get64(const uint16_t *reg)
{
    return (uint64_t)ls_wire_get32(reg) << 32 | ls_wire_get32(reg + 2);
}

/** Registers as bytes, high byte first, and back. */
static inline void ls_wire_put_registers(const uint16_t *regs, size_t n, uint8_t *bytes)
{
    for (size_t i = 0; i < n; i++) {
        bytes[2 * i] = (uint8_t)(regs[i] >> 8);
        bytes[2 * i + 1] = (uint8_t)regs[i];
    }
}

static inline void ls_wire_get_registers(const uint8_t *bytes, size_t n, uint16_t *regs)
{
    for (size_t i = 0; i < n; i++)
        regs[i] = (uint16_t)(bytes[2 * i] << 8 | bytes[2 * i + 1]);
}

/** CRC-32C (Castagnoli, reflected 0x82f63b78, initial and final ~0) of @n registers taken as
 * bytes, high byte first. Of the bytes "123456789\0": 0xc3389d4f; of 32 zero bytes: 0x8a9136aa. */
static inline uint32_t ls_wire_crc32c(const uint16_t *reg, size_t n)
{
    uint32_t table[16];
    for (uint32_t i = 0; i < 16; i++) {
        table[i] = i;
        for (int bit = 0; bit < 4; bit++)
            table[i] = table[i] >> 1 ^ (table[i] & 1 ? 0x82f63b78u : 0);
    }
    uint32_t crc = ~0u;
    for (size_t k = 0; k < 2 * n; k++) {
        crc ^= k & 1 ? reg[k / 2] & 0xff : reg[k / 2] >> 8;
        crc = crc >> 4 ^ table[crc & 15];
        crc = crc >> 4 ^ table[crc & 15];
    }
    return ~crc;
}

#endif
