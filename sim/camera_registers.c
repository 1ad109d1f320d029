#include "sim/camera_registers.h"

#include "sim/camera_xml.h"

#include <arpa/inet.h>
#include <arv.h>
#include <errno.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

struct sim_registers {
    ArvFakeCamera *fake;
    pthread_mutex_t lock;
    struct sim_camera_config config; /* its numbers */
    uint32_t sensor_width, sensor_height;
    uint32_t xml_bytes;
};

static const uint32_t pixel_formats[] = {
    0x01080001, /* Mono8 */
    0x01100005, /* Mono12 */
    0x01100007, /* Mono16 */
    0x010c0006, /* Mono12Packed */
    0x01080008, /* BayerGR8 */
    0x01080009, /* BayerRG8 */
    0x0108000a, /* BayerGB8 */
    0x0108000b, /* BayerBG8 */
    0x01100010, /* BayerGR12 */
    0x01100011, /* BayerRG12 */
    0x01100012, /* BayerGB12 */
    0x01100013, /* BayerBG12 */
    0x010c002a, /* BayerGR12Packed */
    0x010c002b, /* BayerRG12Packed */
    0x010c002c, /* BayerGB12Packed */
    0x010c002d, /* BayerBG12Packed */
};

/** What a host may write: integers in [min, max], floats clamped to it. */
static const struct rule {
    uint32_t address;
    enum { ENUM, INT, FLOAT } kind;
    bool locked; /* while acquiring */
    float min, max;
} rules[] = {
    {SIM_REG_HEARTBEAT_MS, INT, false, 100, 60000},
    {SIM_REG_TIMESTAMP_CONTROL, ENUM, false, 0, 3},
    {SIM_REG_CONTROL, ENUM, false, 0, 3},
    {SIM_REG_STREAM_PORT, INT, false, 0, 65535},
    {SIM_REG_PACKET_DELAY, INT, false, 0, 1000000},
    {SIM_REG_ACQUISITION_MODE, ENUM, true, 0, 1},
    {SIM_REG_ACQUISITION_START, INT, false, 0, 1},
    {SIM_REG_ACQUISITION_STOP, INT, false, 0, 1},
    {SIM_REG_FRAME_RATE_ENABLE, ENUM, false, 0, 1},
    {SIM_REG_FRAME_RATE, FLOAT, false, 0.1f, 1000},
    {SIM_REG_TRIGGER_MODE, ENUM, true, 0, 1},
    {SIM_REG_TRIGGER_SOURCE, ENUM, true, 0, 1},
    {SIM_REG_TRIGGER_ACTIVATION, ENUM, true, 0, 0},
    {SIM_REG_TRIGGER_SOFTWARE, INT, false, 0, 1},
    {SIM_REG_EXPOSURE_MODE, ENUM, true, 0, 1},
    {SIM_REG_EXPOSURE_TIME, FLOAT, false, 10, 1e7f},
    {SIM_REG_EXPOSURE_AUTO, ENUM, false, 0, 0},
    {SIM_REG_GAIN, FLOAT, false, 0, 24},
    {SIM_REG_GAIN_AUTO, ENUM, false, 0, 0},
    {SIM_REG_GAMMA, FLOAT, false, 1, 1},
    {SIM_REG_GAMMA_ENABLE, ENUM, false, 0, 0},
    {SIM_REG_BALANCE_WHITE_AUTO, ENUM, false, 0, 0},
    {SIM_REG_LUT_ENABLE, ENUM, false, 0, 0},
    {SIM_REG_CHUNK_MODE, ENUM, true, 0, 1},
    {SIM_REG_CHUNK_SELECTOR, ENUM, false, 0, SIM_N_CHUNKS - 1},
    {SIM_REG_CHUNK_ENABLE + 4 * SIM_CHUNK_IMAGE, INT, true, 1, 1},
    {SIM_REG_CHUNK_ENABLE + 4 * SIM_CHUNK_TIMESTAMP, ENUM, true, 0, 1},
    {SIM_REG_CHUNK_ENABLE + 4 * SIM_CHUNK_EXPOSURE, ENUM, true, 0, 1},
    {SIM_REG_CHUNK_ENABLE + 4 * SIM_CHUNK_COUNTER, ENUM, true, 0, 1},
    {SIM_REG_PARAMS_LOCKED, ENUM, false, 0, 1},
};

static uint32_t float_word(float value)
{
    uint32_t word;
    memcpy(&word, &value, sizeof word);
    return word;
}

static float word_float(uint32_t word)
{
    float value;
    memcpy(&value, &word, sizeof value);
    return value;
}

static uint32_t get(struct sim_registers *r, uint32_t address)
{
    guint32 value = 0;
    arv_fake_camera_read_register(r->fake, address, &value);
    return value;
}

static void set(struct sim_registers *r, uint32_t address, uint32_t value)
{
    arv_fake_camera_write_register(r->fake, address, value);
}

static void set_text(struct sim_registers *r, uint32_t address, size_t size, const char *text)
{
    char field[512] = {0};
    g_strlcpy(field, text, size);
    arv_fake_camera_write_memory(r->fake, address, (guint32)size, field);
}

uint32_t sim_image_bytes(uint32_t pixel_format, uint32_t width, uint32_t height)
{
    uint64_t bits = pixel_format >> 16 & 0xff;
    return (uint32_t)(((uint64_t)width * height * bits + 7) / 8);
}

static uint32_t padded(uint32_t bytes)
{
    return (bytes + 3) & ~3u;
}

static uint32_t payload_bytes(struct sim_registers *r)
{
    static const uint32_t chunk_bytes[SIM_N_CHUNKS] = {0, 8, 8, 4};
    uint32_t image = sim_image_bytes(get(r, SIM_REG_PIXEL_FORMAT), get(r, SIM_REG_WIDTH),
                                     get(r, SIM_REG_HEIGHT));
    if (!get(r, SIM_REG_CHUNK_MODE))
        return image;
    uint32_t total = padded(image) + 8;
    for (uint32_t chunk = 1; chunk < SIM_N_CHUNKS; chunk++)
        if (get(r, SIM_REG_CHUNK_ENABLE + 4 * chunk))
            total += chunk_bytes[chunk] + 8;
    return total;
}

static uint32_t clamped(uint32_t value, uint32_t min, uint32_t max)
{
    return value < min ? min : value > max ? max : value;
}

/** Offsets give way to sizes, sizes are cut at the sensor's edge. */
static bool write_geometry(struct sim_registers *r, uint32_t address, uint32_t value)
{
    switch (address) {
    case SIM_REG_WIDTH:
        set(r, address, clamped(value, 4, r->sensor_width - get(r, SIM_REG_OFFSET_X)));
        return true;
    case SIM_REG_HEIGHT:
        set(r, address, clamped(value, 4, r->sensor_height - get(r, SIM_REG_OFFSET_Y)));
        return true;
    case SIM_REG_OFFSET_X:
        set(r, address, clamped(value, 0, r->sensor_width - get(r, SIM_REG_WIDTH)));
        return true;
    case SIM_REG_OFFSET_Y:
        set(r, address, clamped(value, 0, r->sensor_height - get(r, SIM_REG_HEIGHT)));
        return true;
    }
    return false;
}

static enum sim_gvcp_status write_pixel_format(struct sim_registers *r, uint32_t value)
{
    for (size_t i = 0; i < sizeof pixel_formats / sizeof *pixel_formats; i++)
        if (pixel_formats[i] == value) {
            set(r, SIM_REG_PIXEL_FORMAT, value);
            return SIM_GVCP_OK;
        }
    return SIM_GVCP_INVALID_PARAMETER;
}

static enum sim_gvcp_status write_by_rule(struct sim_registers *r, const struct rule *rule,
                                          uint32_t value, bool acquiring)
{
    if (rule->locked && acquiring)
        return SIM_GVCP_BUSY;
    if (rule->kind == FLOAT) {
        float number = word_float(value);
        if (!(number == number))
            return SIM_GVCP_INVALID_PARAMETER;
        number = number < rule->min ? rule->min : number > rule->max ? rule->max : number;
        set(r, rule->address, float_word(number));
        return SIM_GVCP_OK;
    }
    uint32_t min = (uint32_t)rule->min, max = (uint32_t)rule->max;
    if (rule->kind == ENUM && (value < min || value > max))
        return SIM_GVCP_INVALID_PARAMETER;
    set(r, rule->address, clamped(value, min, max));
    return SIM_GVCP_OK;
}

static bool is_text(uint32_t address)
{
    return address >= SIM_REG_USER_NAME && address < SIM_REG_DISCOVERY_END;
}

static enum sim_gvcp_status write_locked(struct sim_registers *r, uint32_t address, uint32_t value,
                                         bool acquiring)
{
    if (address >= SIM_REG_WIDTH && address <= SIM_REG_PIXEL_FORMAT && acquiring)
        return SIM_GVCP_BUSY;
    if (write_geometry(r, address, value))
        return SIM_GVCP_OK;
    switch (address) {
    case SIM_REG_PIXEL_FORMAT:
        return write_pixel_format(r, value);
    case SIM_REG_PACKET_SIZE:
        set(r, address, (value & 0x7fff0000) | clamped(value & 0xffff, 576, 65500));
        return SIM_GVCP_OK;
    case SIM_REG_BLACK_LEVEL:
        return SIM_GVCP_OK; /* fixed by the sensor */
    case SIM_REG_STREAM_ADDRESS:
        set(r, address, value);
        return SIM_GVCP_OK;
    }
    for (size_t i = 0; i < sizeof rules / sizeof *rules; i++)
        if (rules[i].address == address)
            return write_by_rule(r, &rules[i], value, acquiring);
    if (!is_text(address))
        return address < ARV_FAKE_CAMERA_MEMORY_SIZE ? SIM_GVCP_WRITE_PROTECT
                                                     : SIM_GVCP_INVALID_ADDRESS;
    set(r, address, value);
    return SIM_GVCP_OK;
}

enum sim_gvcp_status sim_registers_write(struct sim_registers *r, uint32_t address, uint32_t value,
                                         bool acquiring)
{
    if (address & 3)
        return SIM_GVCP_BAD_ALIGNMENT;
    pthread_mutex_lock(&r->lock);
    enum sim_gvcp_status status = write_locked(r, address, value, acquiring);
    set(r, SIM_REG_PAYLOAD, payload_bytes(r));
    pthread_mutex_unlock(&r->lock);
    return status;
}

enum sim_gvcp_status sim_registers_read(struct sim_registers *r, uint32_t address, uint32_t size,
                                        void *data)
{
    if (address & 3)
        return SIM_GVCP_BAD_ALIGNMENT;
    uint64_t end = ARV_FAKE_CAMERA_MEMORY_SIZE + (uint64_t)padded(r->xml_bytes);
    if ((uint64_t)address + size > end)
        return SIM_GVCP_INVALID_ADDRESS;
    memset(data, 0, size);
    pthread_mutex_lock(&r->lock);
    arv_fake_camera_read_memory(r->fake, address, size, data);
    pthread_mutex_unlock(&r->lock);
    return SIM_GVCP_OK;
}

uint32_t sim_registers_get(struct sim_registers *r, uint32_t address)
{
    pthread_mutex_lock(&r->lock);
    uint32_t value = get(r, address);
    pthread_mutex_unlock(&r->lock);
    return value;
}

void sim_registers_set(struct sim_registers *r, uint32_t address, uint32_t value)
{
    pthread_mutex_lock(&r->lock);
    set(r, address, value);
    pthread_mutex_unlock(&r->lock);
}

static void read_settings(struct sim_registers *r, struct sim_camera_settings *s)
{
    s->format = (struct sim_raw_format){
        .width = get(r, SIM_REG_WIDTH),
        .height = get(r, SIM_REG_HEIGHT),
        .offset_x = get(r, SIM_REG_OFFSET_X),
        .offset_y = get(r, SIM_REG_OFFSET_Y),
        .pixel_format = get(r, SIM_REG_PIXEL_FORMAT),
        .gain_db = (double)word_float(get(r, SIM_REG_GAIN)),
    };
    s->image_bytes = sim_image_bytes(s->format.pixel_format, s->format.width, s->format.height);
    s->payload_bytes = payload_bytes(r);
    s->chunks = get(r, SIM_REG_CHUNK_MODE);
    for (uint32_t chunk = 0; chunk < SIM_N_CHUNKS; chunk++)
        s->chunk[chunk] = s->chunks && get(r, SIM_REG_CHUNK_ENABLE + 4 * chunk);
    s->trigger_on = get(r, SIM_REG_TRIGGER_MODE);
    s->trigger_line = get(r, SIM_REG_TRIGGER_SOURCE) == 0;
    s->trigger_width = get(r, SIM_REG_EXPOSURE_MODE) == 1;
    s->single_frame = get(r, SIM_REG_ACQUISITION_MODE) == 1;
    s->frame_rate_on = get(r, SIM_REG_FRAME_RATE_ENABLE);
    s->exposure_us = (double)word_float(get(r, SIM_REG_EXPOSURE_TIME));
    s->frame_rate_hz = (double)word_float(get(r, SIM_REG_FRAME_RATE));
    s->stream_address = get(r, SIM_REG_STREAM_ADDRESS);
    s->stream_port = get(r, SIM_REG_STREAM_PORT);
    s->packet_size = get(r, SIM_REG_PACKET_SIZE) & 0xffff;
    s->packet_delay_ns = get(r, SIM_REG_PACKET_DELAY);
}

void sim_registers_settings(struct sim_registers *r, struct sim_camera_settings *settings)
{
    pthread_mutex_lock(&r->lock);
    read_settings(r, settings);
    pthread_mutex_unlock(&r->lock);
}

/** ArvFakeCamera reads its XML from a file: give it one that never touches a disk. */
static ArvFakeCamera *create_fake(const char *serial)
{
    ArvFakeCamera *fake = NULL;
    char path[64];
    int fd = memfd_create("camera.xml", MFD_CLOEXEC);
    if (fd < 0)
        return NULL;
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    if (write(fd, sim_camera_xml, sim_camera_xml_bytes) == (ssize_t)sim_camera_xml_bytes)
        fake = arv_fake_camera_new_full(serial, path);
    close(fd);
    return fake;
}

static void power_up_bootstrap(struct sim_registers *r, const struct sim_camera_config *config,
                               uint32_t ip_address)
{
    char text[64];
    set(r, SIM_REG_VERSION, 0x00010002);
    set(r, SIM_REG_DEVICE_MODE, 0x80000001); /* big-endian, UTF-8 */
    set(r, SIM_REG_MAC_HIGH, 0x0200);        /* locally administered */
    set(r, SIM_REG_MAC_LOW, ip_address);
    set(r, SIM_REG_IP_OPTIONS, 0x4); /* link-local */
    set(r, SIM_REG_IP_MODE, 0x4);
    set(r, SIM_REG_IP_ADDRESS, ip_address);
    set(r, SIM_REG_IP_MASK, 0xff000000);
    set_text(r, SIM_REG_MANUFACTURER, 32, "lightstaged");
    set_text(r, SIM_REG_MODEL, 32, config->model ? config->model : "lightstage-sim");
    set_text(r, SIM_REG_DEVICE_VERSION, 32, "1");
    set_text(r, SIM_REG_MANUFACTURER_INFO, 48, "simulated camera");
    snprintf(text, sizeof text, "SIM%u", config->index);
    set_text(r, SIM_REG_SERIAL, 16, config->serial ? config->serial : text);
    snprintf(text, sizeof text, "sim-camera-%u", config->index);
    set_text(r, SIM_REG_USER_NAME, 16, text);
    snprintf(text, sizeof text, "Local:lightstage_sim.xml;%x;%x", ARV_FAKE_CAMERA_MEMORY_SIZE,
             r->xml_bytes);
    set_text(r, SIM_REG_XML_URL, 512, text);
    set(r, SIM_REG_N_INTERFACES, 1);
    set(r, SIM_REG_N_MESSAGE_CHANNELS, 0);
    set(r, SIM_REG_N_STREAM_CHANNELS, 1);
    set(r, SIM_REG_CAPABILITY, 0xc0000007); /* user name, serial; resend, writemem, concatenation */
    set(r, SIM_REG_TICK_HZ_HIGH, 0);
    set(r, SIM_REG_TICK_HZ_LOW, 1000000000);
}

static void power_up_features(struct sim_registers *r)
{
    const struct sim_camera_config *config = &r->config;
    for (uint32_t address = SIM_REG_SENSOR_WIDTH; address <= SIM_REG_PARAMS_LOCKED; address += 4)
        set(r, address, 0);
    set(r, SIM_REG_HEARTBEAT_MS, 3000);
    set(r, SIM_REG_CONTROL, 0);
    set(r, SIM_REG_STREAM_PORT, 0);
    set(r, SIM_REG_PACKET_SIZE, 1500);
    set(r, SIM_REG_PACKET_DELAY, 0);
    double rate = config->max_frame_rate_hz > 0 ? config->max_frame_rate_hz : 100;
    set(r, SIM_REG_SENSOR_WIDTH, config->sensor_width);
    set(r, SIM_REG_SENSOR_HEIGHT, config->sensor_height);
    set(r, SIM_REG_WIDTH, config->sensor_width);
    set(r, SIM_REG_HEIGHT, config->sensor_height);
    set(r, SIM_REG_PIXEL_FORMAT, config->pixel_format ? config->pixel_format : pixel_formats[0]);
    set(r, SIM_REG_SHUTTER_MODE, config->rolling);
    set(r, SIM_REG_HAS_TRIGGER_WIDTH, !config->timed_only);
    set(r, SIM_REG_FRAME_RATE, float_word((float)(rate < 25 ? rate : 25)));
    set(r, SIM_REG_EXPOSURE_TIME, float_word(1000));
    set(r, SIM_REG_BLACK_LEVEL, float_word((float)config->black_level_dn));
    set(r, SIM_REG_GAMMA, float_word(1));
    set(r, SIM_REG_CHUNK_ENABLE + 4 * SIM_CHUNK_IMAGE, 1);
    set(r, SIM_REG_PAYLOAD, payload_bytes(r));
}

enum ls_err sim_registers_create(const struct sim_camera_config *config, uint32_t ip_address,
                                 struct sim_registers **out, struct ls_diag *diag)
{
    struct sim_registers *r = calloc(1, sizeof *r);
    if (!r)
        return LS_ERR_NOMEM;
    r->fake = create_fake(config->serial ? config->serial : "SIM");
    if (!r->fake) {
        free(r);
        return ls_fail(diag, LS_ERR_OS, "camera %s: cannot make its register memory: %s",
                       config->address, strerror(errno));
    }
    pthread_mutex_init(&r->lock, NULL);
    r->config = *config;
    r->config.address = r->config.serial = r->config.model = NULL;
    r->sensor_width = config->sensor_width;
    r->sensor_height = config->sensor_height;
    r->xml_bytes = (uint32_t)sim_camera_xml_bytes;
    power_up_bootstrap(r, config, ip_address);
    power_up_features(r);
    *out = r;
    return LS_OK;
}

void sim_registers_reboot(struct sim_registers *r)
{
    pthread_mutex_lock(&r->lock);
    power_up_features(r);
    set(r, SIM_REG_GAIN, float_word(6));
    pthread_mutex_unlock(&r->lock);
}

void sim_registers_destroy(struct sim_registers *r)
{
    if (!r)
        return;
    g_object_unref(r->fake);
    pthread_mutex_destroy(&r->lock);
    free(r);
}
