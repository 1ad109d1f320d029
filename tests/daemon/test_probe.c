#include "daemon/probe.h"

#include <arpa/inet.h>
#include <glib.h>
#include <sys/socket.h>
#include <unistd.h>

enum { TIMEOUT_MS = 500 };

static const int64_t hour_us = (int64_t)3600 * 1000000;

/* A controller that lets anybody connect and never says a word. */
struct silent {
    int fd;
    struct ls_config config;
};

static void silent_start(struct silent *silent)
{
    struct sockaddr_in at = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t length = sizeof at;
    silent->fd = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK, 0);
    g_assert_cmpint(silent->fd, >=, 0);
    g_assert_cmpint(bind(silent->fd, (struct sockaddr *)&at, length), ==, 0);
    g_assert_cmpint(listen(silent->fd, 16), ==, 0);
    g_assert_cmpint(getsockname(silent->fd, (struct sockaddr *)&at, &length), ==, 0);
    silent->config = (struct ls_config){.lights_driver = {.driver = "modbus",
                                                          .address = "127.0.0.1",
                                                          .port = ntohs(at.sin_port),
                                                          .unit = 1,
                                                          .timeout_ms = TIMEOUT_MS}};
}

static int silent_visits(const struct silent *silent)
{
    int n = 0, fd;
    while ((fd = accept(silent->fd, NULL, NULL)) >= 0) {
        close(fd);
        n++;
    }
    return n;
}

static int64_t look_us(struct ls_probe *probe)
{
    struct ls_devices devices;
    int64_t before = g_get_monotonic_time();
    ls_probe_look(probe, &devices);
    g_assert_false(devices.lights_connected);
    return g_get_monotonic_time() - before;
}

static void test_silence(void)
{
    struct silent silent;
    silent_start(&silent);
    struct ls_probe *probe = ls_probe_create(&silent.config, 0, 20000);
    int64_t first = look_us(probe), second = look_us(probe);
    g_test_message("first %lld us, second %lld us", (long long)first, (long long)second);
    /* the first has nothing else to say; the second's probe goes on for a whole timeout */
    g_assert_cmpint(first, >=, TIMEOUT_MS * 1000);
    g_assert_cmpint(second, <, TIMEOUT_MS * 1000);
    ls_probe_destroy(probe);
    close(silent.fd);
}

static void test_memory(void)
{
    struct silent silent;
    silent_start(&silent);
    struct ls_probe *probe = ls_probe_create(&silent.config, hour_us, hour_us);
    look_us(probe);
    int visits = silent_visits(&silent);
    g_assert_cmpint(visits, >, 0);
    look_us(probe);
    g_assert_cmpint(silent_visits(&silent), ==, 0);
    ls_probe_release(probe);
    look_us(probe);
    g_assert_cmpint(silent_visits(&silent), ==, visits);
    ls_probe_destroy(probe);
    close(silent.fd);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/probe/a-silent-controller-delays-only-the-first-answer", test_silence);
    g_test_add_func("/probe/a-finding-is-remembered-until-the-devices-are-released", test_memory);
    return g_test_run();
}
