/*
 * camera_registers: the register memory of a simulated camera: bootstrap registers of the GigE
 * Vision standard below 0x8000, those of camera.xml from 0x8000 on.
 * Layer: sim. Threads: any; every call takes the registers' own lock and returns at once.
 * Ownership: owns the ArvFakeCamera that holds memory and XML.
 *
 * Writes behave like a camera's: values are clamped to what the sensor can do and read back as
 * such, enumerations it does not know are refused, read-only registers are protected, and the
 * geometry is locked while acquiring. Registers are 32-bit big-endian words; floats are IEEE 754.
 */
#ifndef LS_SIM_CAMERA_REGISTERS_H
#define LS_SIM_CAMERA_REGISTERS_H

#include "sim/camera.h"

#include <stddef.h>

enum sim_register {
    /* bootstrap */
    SIM_REG_VERSION = 0x0000,
    SIM_REG_DEVICE_MODE = 0x0004,
    SIM_REG_MAC_HIGH = 0x0008,
    SIM_REG_MAC_LOW = 0x000c,
    SIM_REG_IP_OPTIONS = 0x0010,
    SIM_REG_IP_MODE = 0x0014,
    SIM_REG_IP_ADDRESS = 0x0024,
    SIM_REG_IP_MASK = 0x0034,
    SIM_REG_MANUFACTURER = 0x0048,
    SIM_REG_MODEL = 0x0068,
    SIM_REG_DEVICE_VERSION = 0x0088,
    SIM_REG_MANUFACTURER_INFO = 0x00a8,
    SIM_REG_SERIAL = 0x00d8,
    SIM_REG_USER_NAME = 0x00e8,
    SIM_REG_DISCOVERY_END = 0x00f8,
    SIM_REG_XML_URL = 0x0200,
    SIM_REG_N_INTERFACES = 0x0600,
    SIM_REG_N_MESSAGE_CHANNELS = 0x0900,
    SIM_REG_N_STREAM_CHANNELS = 0x0904,
    SIM_REG_CAPABILITY = 0x0934,
    SIM_REG_HEARTBEAT_MS = 0x0938,
    SIM_REG_TICK_HZ_HIGH = 0x093c,
    SIM_REG_TICK_HZ_LOW = 0x0940,
    SIM_REG_TIMESTAMP_CONTROL = 0x0944, /* bit 1: latch */
    SIM_REG_TIMESTAMP_HIGH = 0x0948,
    SIM_REG_TIMESTAMP_LOW = 0x094c,
    SIM_REG_CONTROL = 0x0a00, /* bit 0 exclusive, bit 1 control */
    SIM_REG_STREAM_PORT = 0x0d00,
    SIM_REG_PACKET_SIZE = 0x0d04, /* bit 31: fire a test packet */
    SIM_REG_PACKET_DELAY = 0x0d08,
    SIM_REG_STREAM_ADDRESS = 0x0d18,
    SIM_REG_STREAM_SOURCE = 0x0d1c,
    /* camera.xml */
    SIM_REG_SENSOR_WIDTH = 0x8000,
    SIM_REG_SENSOR_HEIGHT = 0x8004,
    SIM_REG_WIDTH = 0x8008,
    SIM_REG_HEIGHT = 0x800c,
    SIM_REG_OFFSET_X = 0x8010,
    SIM_REG_OFFSET_Y = 0x8014,
    SIM_REG_PIXEL_FORMAT = 0x8018,
    SIM_REG_SHUTTER_MODE = 0x801c,
    SIM_REG_HAS_TRIGGER_WIDTH = 0x8040,
    SIM_REG_PAYLOAD = 0x8020,
    SIM_REG_ACQUISITION_MODE = 0x8100,
    SIM_REG_ACQUISITION_START = 0x8104,
    SIM_REG_ACQUISITION_STOP = 0x8108,
    SIM_REG_FRAME_RATE_ENABLE = 0x810c,
    SIM_REG_FRAME_RATE = 0x8110,
    SIM_REG_TRIGGER_MODE = 0x8114,
    SIM_REG_TRIGGER_SOURCE = 0x8118,
    SIM_REG_TRIGGER_ACTIVATION = 0x811c,
    SIM_REG_TRIGGER_SOFTWARE = 0x8120,
    SIM_REG_EXPOSURE_MODE = 0x8124,
    SIM_REG_EXPOSURE_TIME = 0x8128,
    SIM_REG_EXPOSURE_AUTO = 0x812c,
    SIM_REG_GAIN = 0x8200,
    SIM_REG_GAIN_AUTO = 0x8204,
    SIM_REG_BLACK_LEVEL = 0x8208,
    SIM_REG_GAMMA = 0x820c,
    SIM_REG_GAMMA_ENABLE = 0x8210,
    SIM_REG_BALANCE_WHITE_AUTO = 0x8214,
    SIM_REG_LUT_ENABLE = 0x8300,
    SIM_REG_CHUNK_MODE = 0x8400,
    SIM_REG_CHUNK_SELECTOR = 0x8404,
    SIM_REG_CHUNK_ENABLE = 0x8410, /* one word per enum sim_chunk */
    SIM_REG_COUNTER = 0x8420,      /* edges seen on Line0 since power-up */
    SIM_REG_PARAMS_LOCKED = 0x8500,
};

/** ChunkSelector entries; a chunk's id is its entry of sim_chunk_id. */
enum sim_chunk {
    SIM_CHUNK_IMAGE,
    SIM_CHUNK_TIMESTAMP, /* u64, ns */
    SIM_CHUNK_EXPOSURE,  /* double, us */
    SIM_CHUNK_COUNTER,   /* u32 */
    SIM_N_CHUNKS,
};

enum {
    SIM_CHUNK_ID_IMAGE = 0x0001,
    SIM_CHUNK_ID_TIMESTAMP = 0x1001,
    SIM_CHUNK_ID_EXPOSURE = 0x1002,
    SIM_CHUNK_ID_COUNTER = 0x1003,
};

/** Status of the answer to a register access. */
enum sim_gvcp_status {
    SIM_GVCP_OK = 0,
    SIM_GVCP_NOT_IMPLEMENTED = 0x8001,
    SIM_GVCP_INVALID_PARAMETER = 0x8002,
    SIM_GVCP_INVALID_ADDRESS = 0x8003,
    SIM_GVCP_WRITE_PROTECT = 0x8004,
    SIM_GVCP_BAD_ALIGNMENT = 0x8005,
    SIM_GVCP_ACCESS_DENIED = 0x8006,
    SIM_GVCP_BUSY = 0x8007,
    SIM_GVCP_PACKET_UNAVAILABLE = 0x800c,
};

/** Everything an exposure depends on, read at one moment. */
struct sim_camera_settings {
    struct sim_raw_format format;
    uint32_t image_bytes, payload_bytes; /* payload: with chunks */
    bool chunks;
    bool chunk[SIM_N_CHUNKS];
    bool trigger_on, trigger_line, trigger_width, single_frame, frame_rate_on;
    double exposure_us, frame_rate_hz;
    uint32_t stream_address, stream_port; /* host order; 0 = closed */
    uint32_t packet_size, packet_delay_ns;
};

struct sim_registers;

/** Power-up state of the camera @config describes. (transfer full). */
LS_MUST_CHECK enum ls_err sim_registers_create(const struct sim_camera_config *config,
                                               uint32_t ip_address, struct sim_registers **out,
                                               struct ls_diag *diag);

/** Power-up state again, but for the gain: 6 dB, whatever it was. */
void sim_registers_reboot(struct sim_registers *registers);

/** NULL is allowed. */
void sim_registers_destroy(struct sim_registers *registers);

/** The camera's own access to one word: no checks, no side effects. */
uint32_t sim_registers_get(struct sim_registers *registers, uint32_t address);
void sim_registers_set(struct sim_registers *registers, uint32_t address, uint32_t value);

/** A host's read of @size bytes of registers or XML. */
enum sim_gvcp_status sim_registers_read(struct sim_registers *registers, uint32_t address,
                                        uint32_t size, void *data);

/** A host's write of one word; @acquiring locks the geometry. */
enum sim_gvcp_status sim_registers_write(struct sim_registers *registers, uint32_t address,
                                         uint32_t value, bool acquiring);

void sim_registers_settings(struct sim_registers *registers, struct sim_camera_settings *settings);

/** Image bytes of a format: @width x @height pixels without padding. */
uint32_t sim_image_bytes(uint32_t pixel_format, uint32_t width, uint32_t height);

#endif
