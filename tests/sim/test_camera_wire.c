/* The simulated camera's control channel, byte by byte, without Aravis on the other end. */
#include "sim/camera.h"
#include "sim/camera_registers.h"
#include "sim/gvcp.h"

#include <arpa/inet.h>
#include <errno.h>
#include <glib.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

enum { HEADER = 8, ROOM = 2048 };

/** A camera and a host with two sockets: one to control it, one to look on. */
struct wire {
    struct sim_camera *sim;
    struct sockaddr_in camera;
    int host, onlooker;
    uint16_t id;
    uint8_t answer[ROOM]; /* of the last exchange */
};

static void render(void *user, const struct sim_exposure *exposure,
                   const struct sim_raw_format *format, void *raw)
{
    memset(raw, 0, sim_image_bytes(format->pixel_format, format->width, format->height));
}

static void shown(void *user, uint64_t start_ns, uint64_t end_ns, uint32_t *condition,
                  uint32_t *step, double *lit_us)
{
    *condition = *step = UINT32_MAX;
    *lit_us = 0;
}

static int open_socket(void)
{
    struct sockaddr_in any = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    struct timeval limit = {2, 0};
    int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    g_assert_cmpint(bind(fd, (struct sockaddr *)&any, sizeof any), ==, 0);
    setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
    return fd;
}

static struct wire plug_in(void)
{
    struct wire w = {.host = open_socket(), .onlooker = open_socket()};
    char address[16];
    unsigned pid = (unsigned)getpid();
    snprintf(address, sizeof address, "127.%u.%u.251", 64 + (pid >> 8 & 127), pid & 255);
    struct sim_camera_config config = {
        .address = address, .sensor_width = 64, .sensor_height = 64, .black_level_dn = 4};
    struct sim_camera_callbacks callbacks = {.render = render, .shown = shown};
    struct ls_diag diag = {0};
    if (sim_camera_create(&config, &callbacks, &w.sim, &diag))
        g_error("%s", diag.text);
    w.camera = (struct sockaddr_in){.sin_family = AF_INET, .sin_port = htons(SIM_GVCP_PORT)};
    inet_pton(AF_INET, address, &w.camera.sin_addr);
    return w;
}

static void unplug(struct wire *w)
{
    sim_camera_destroy(w->sim);
    close(w->host);
    close(w->onlooker);
}

static void send_to(struct wire *w, int fd, const void *packet, size_t n)
{
    sendto(fd, packet, n, 0, (struct sockaddr *)&w->camera, sizeof w->camera);
}

/** Send a command of big-endian words and return the status answered. */
static unsigned ask(struct wire *w, int fd, uint16_t command, const uint32_t *words, size_t n)
{
    uint8_t packet[HEADER + 64] = {
        0x42, 1, (uint8_t)(command >> 8), (uint8_t)command, 0, (uint8_t)(n * 4)};
    uint16_t id = ++w->id;
    ssize_t got;
    bool again = false;
    packet[6] = (uint8_t)(id >> 8);
    packet[7] = (uint8_t)id;
    for (size_t i = 0; i < n; i++) {
        uint32_t word = htonl(words[i]);
        memcpy(packet + HEADER + 4 * i, &word, 4);
    }
    send_to(w, fd, packet, HEADER + 4 * n);
    do { /* answers to earlier noise may still be on their way */
        got = recv(fd, w->answer, ROOM, 0);
        if (got < 0 && errno == EAGAIN && !again) { /* where noise filled the socket, it is lost */
            again = true;
            send_to(w, fd, packet, HEADER + 4 * n);
            continue;
        }
        g_assert_cmpint(got, >=, HEADER);
    } while (got < 0 || w->answer[6] != packet[6] || w->answer[7] != packet[7]);
    return (unsigned)(w->answer[0] << 8 | w->answer[1]);
}

static unsigned write_register(struct wire *w, int fd, uint32_t address, uint32_t value)
{
    uint32_t words[] = {address, value};
    return ask(w, fd, 0x82, words, 2);
}

static uint32_t read_register(struct wire *w, int fd, uint32_t address)
{
    uint32_t word;
    g_assert_cmphex(ask(w, fd, 0x80, &address, 1), ==, SIM_GVCP_OK);
    memcpy(&word, w->answer + HEADER, 4);
    return ntohl(word);
}

static void test_discovery(void)
{
    struct wire w = plug_in();
    uint32_t address;
    g_assert_cmphex(ask(&w, w.onlooker, 0x02, NULL, 0), ==, SIM_GVCP_OK);
    g_assert_cmphex(w.answer[3], ==, 0x03);
    g_assert_cmphex(w.answer[5], ==, 0xf8);
    memcpy(&address, w.answer + HEADER + SIM_REG_IP_ADDRESS, 4);
    g_assert_cmphex(address, ==, w.camera.sin_addr.s_addr);
    g_assert_cmpstr((char *)w.answer + HEADER + SIM_REG_MODEL, ==, "lightstage-sim");
    unplug(&w);
}

static void test_noise(void)
{
    struct wire w = plug_in();
    uint32_t seed = g_test_rand_int_range(0, 1 << 30);
    GRand *rand = g_rand_new_with_seed(seed);
    uint8_t packet[700];
    g_test_message("seed %u", seed);
    for (int i = 0; i < 3000; i++) {
        static const uint8_t commands[] = {0x02, 0x40, 0x80, 0x82, 0x84, 0x86, 0xff};
        size_t n = (size_t)g_rand_int_range(rand, 0, sizeof packet);
        for (size_t k = 0; k < sizeof packet; k++)
            packet[k] = (uint8_t)g_rand_int(rand);
        packet[0] = 0x42;
        packet[2] = 0;
        packet[3] = commands[g_rand_int_range(rand, 0, sizeof commands)];
        if (i % 2) { /* a length that is true, and an address that exists */
            packet[4] = (uint8_t)((n - HEADER) >> 8);
            packet[5] = (uint8_t)(n - HEADER);
            packet[8] = packet[9] = 0;
        }
        packet[6] = 0x80; /* ids ask() never uses */
        send_to(&w, w.host, packet, n);
    }
    g_assert_cmphex(ask(&w, w.onlooker, 0x02, NULL, 0), ==, SIM_GVCP_OK);
    g_rand_free(rand);
    unplug(&w);
}

static void test_control(void)
{
    struct wire w = plug_in();
    g_assert_cmphex(write_register(&w, w.host, SIM_REG_WIDTH, 32), ==, SIM_GVCP_ACCESS_DENIED);
    g_assert_cmphex(write_register(&w, w.host, SIM_REG_CONTROL, 2), ==, SIM_GVCP_OK);
    g_assert_cmphex(write_register(&w, w.host, SIM_REG_WIDTH, 32), ==, SIM_GVCP_OK);
    g_assert_cmphex(write_register(&w, w.onlooker, SIM_REG_CONTROL, 2), ==, SIM_GVCP_ACCESS_DENIED);
    g_assert_cmphex(write_register(&w, w.onlooker, SIM_REG_WIDTH, 16), ==, SIM_GVCP_ACCESS_DENIED);
    g_assert_cmpuint(read_register(&w, w.onlooker, SIM_REG_WIDTH), ==, 32);
    g_assert_cmphex(write_register(&w, w.host, SIM_REG_CONTROL, 0), ==, SIM_GVCP_OK);
    g_assert_cmphex(write_register(&w, w.onlooker, SIM_REG_CONTROL, 2), ==, SIM_GVCP_OK);
    unplug(&w);
}

static void test_heartbeat(void)
{
    struct wire w = plug_in();
    uint64_t start = sim_now_ns();
    g_assert_cmphex(write_register(&w, w.host, SIM_REG_CONTROL, 2), ==, SIM_GVCP_OK);
    g_assert_cmphex(write_register(&w, w.host, SIM_REG_HEARTBEAT_MS, 100), ==, SIM_GVCP_OK);
    while (write_register(&w, w.onlooker, SIM_REG_CONTROL, 2) == SIM_GVCP_ACCESS_DENIED)
        g_assert_cmpuint(sim_now_ns() - start, <, 5000000000u);
    g_assert_cmpuint(sim_now_ns() - start, >=, 100000000u);
    unplug(&w);
}

static void test_registers(void)
{
    struct wire w = plug_in();
    g_assert_cmphex(write_register(&w, w.host, SIM_REG_CONTROL, 2), ==, SIM_GVCP_OK);
    g_assert_cmphex(write_register(&w, w.host, SIM_REG_SENSOR_WIDTH, 9), ==,
                    SIM_GVCP_WRITE_PROTECT);
    g_assert_cmphex(write_register(&w, w.host, 0xfffffff0, 9), ==, SIM_GVCP_INVALID_ADDRESS);
    g_assert_cmphex(write_register(&w, w.host, SIM_REG_WIDTH + 1, 9), ==, SIM_GVCP_BAD_ALIGNMENT);
    g_assert_cmphex(write_register(&w, w.host, SIM_REG_PIXEL_FORMAT, 0x02180014), ==,
                    SIM_GVCP_INVALID_PARAMETER);
    g_assert_cmphex(write_register(&w, w.host, SIM_REG_OFFSET_X, 8), ==, SIM_GVCP_OK);
    g_assert_cmpuint(read_register(&w, w.host, SIM_REG_OFFSET_X), ==, 0); /* full width: no room */
    g_assert_cmphex(write_register(&w, w.host, SIM_REG_WIDTH, 1000), ==, SIM_GVCP_OK);
    g_assert_cmpuint(read_register(&w, w.host, SIM_REG_WIDTH), ==, 64);
    g_assert_cmphex(write_register(&w, w.host, SIM_REG_ACQUISITION_START, 1), ==, SIM_GVCP_OK);
    g_assert_cmphex(write_register(&w, w.host, SIM_REG_WIDTH, 32), ==, SIM_GVCP_BUSY);
    unplug(&w);
}

static void test_stream(void)
{
    struct wire w = plug_in();
    struct sockaddr_in at;
    socklen_t size = sizeof at;
    uint8_t packet[ROOM];
    int stream = open_socket();
    getsockname(stream, (struct sockaddr *)&at, &size);
    write_register(&w, w.host, SIM_REG_CONTROL, 2);
    write_register(&w, w.host, SIM_REG_STREAM_ADDRESS, ntohl(at.sin_addr.s_addr));
    write_register(&w, w.host, SIM_REG_STREAM_PORT, ntohs(at.sin_port));
    g_assert_cmphex(write_register(&w, w.host, SIM_REG_PACKET_SIZE, 1u << 31 | 1200), ==,
                    SIM_GVCP_OK);
    /* the test packet: 1200 bytes with its IP and UDP headers */
    g_assert_cmpint(recv(stream, packet, ROOM, 0), ==, 1200 - 28);
    g_assert_cmpuint(read_register(&w, w.host, SIM_REG_PACKET_SIZE), ==, 1200);
    uint8_t resend[] = {0x42, 0, 0, 0x40, 0, 12, 0, 9, 0, 0, 3, 0xe7, 0, 0, 0, 1, 0, 0, 0, 2};
    send_to(&w, w.host, resend, sizeof resend);
    g_assert_cmpint(recv(stream, packet, ROOM, 0), ==, 8);
    g_assert_cmphex((unsigned)(packet[0] << 8 | packet[1]), ==, SIM_GVCP_PACKET_UNAVAILABLE);
    g_assert_cmphex((unsigned)(packet[2] << 8 | packet[3]), ==, 999);
    close(stream);
    unplug(&w);
}

static void test_address_in_use(void)
{
    struct wire w = plug_in();
    char address[INET_ADDRSTRLEN];
    struct sim_camera *second = NULL;
    struct ls_diag diag = {0};
    inet_ntop(AF_INET, &w.camera.sin_addr, address, sizeof address);
    struct sim_camera_config config = {.address = address, .sensor_width = 64, .sensor_height = 64};
    struct sim_camera_callbacks callbacks = {.render = render, .shown = shown};
    g_assert_cmpint(sim_camera_create(&config, &callbacks, &second, &diag), ==, LS_ERR_BUSY);
    g_assert_nonnull(strstr(diag.text, address));
    unplug(&w);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/camera-wire/discovery-describes-the-camera", test_discovery);
    g_test_add_func("/camera-wire/noise-changes-nothing", test_noise);
    g_test_add_func("/camera-wire/only-the-controller-writes", test_control);
    g_test_add_func("/camera-wire/a-silent-controller-loses-control", test_heartbeat);
    g_test_add_func("/camera-wire/registers-refuse-what-the-sensor-cannot", test_registers);
    g_test_add_func("/camera-wire/test-packets-and-refused-resends-reach-the-stream", test_stream);
    g_test_add_func("/camera-wire/an-address-in-use-is-named", test_address_in_use);
    return g_test_run();
}
