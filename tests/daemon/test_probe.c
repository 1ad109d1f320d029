#include "daemon/probe.h"

#include <arpa/inet.h>
#include <glib.h>
#include <semaphore.h>
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

/* Someone who asks, and is told. */
struct asker {
    struct ls_look look;
    bool told;
    struct ls_devices devices;
};

static void on_told(struct ls_look *look, const struct ls_devices *found)
{
    struct asker *asker = (struct asker *)look;
    asker->devices = *found;
    asker->told = true;
}

static int64_t look_us(struct ls_probe *probe)
{
    struct asker asker = {.look.done = on_told};
    int64_t before = g_get_monotonic_time();
    ls_probe_look(probe, &asker.look);
    while (!asker.told)
        g_main_context_iteration(NULL, TRUE);
    g_assert_false(asker.devices.lights_connected);
    return g_get_monotonic_time() - before;
}

static void probe_end(struct ls_probe *probe, struct ls_errands *errands)
{
    ls_errands_end(errands);
    ls_probe_destroy(probe);
    ls_errands_destroy(errands);
}

static void test_silence(void)
{
    struct silent silent;
    silent_start(&silent);
    struct ls_errands *errands = ls_errands_create();
    struct ls_probe *probe = ls_probe_create(&silent.config, errands, 0, 20000);
    int64_t first = look_us(probe), second = look_us(probe);
    g_test_message("first %lld us, second %lld us", (long long)first, (long long)second);
    /* the first has nothing else to say; the second's probe goes on for a whole timeout */
    g_assert_cmpint(first, >=, TIMEOUT_MS * 1000);
    g_assert_cmpint(second, <, TIMEOUT_MS * 1000);
    probe_end(probe, errands);
    close(silent.fd);
}

static void test_memory(void)
{
    struct silent silent;
    silent_start(&silent);
    struct ls_errands *errands = ls_errands_create();
    struct ls_probe *probe = ls_probe_create(&silent.config, errands, hour_us, hour_us);
    look_us(probe);
    int visits = silent_visits(&silent);
    g_assert_cmpint(visits, >, 0);
    look_us(probe);
    g_assert_cmpint(silent_visits(&silent), ==, 0);
    ls_probe_forget(probe);
    look_us(probe);
    g_assert_cmpint(silent_visits(&silent), ==, visits);
    probe_end(probe, errands);
    close(silent.fd);
}

/* An errand that holds ls-rig until it is let go. */
struct visit {
    struct ls_errand errand;
    sem_t go;
    bool done;
};

static void stay(struct ls_errand *errand)
{
    sem_wait(&((struct visit *)errand)->go);
}

static void went(struct ls_errand *errand)
{
    ((struct visit *)errand)->done = true;
}

static void test_others(void)
{
    struct silent silent;
    silent_start(&silent);
    struct ls_errands *errands = ls_errands_create();
    struct ls_probe *probe = ls_probe_create(&silent.config, errands, 0, 20000);
    struct visit visit = {.errand = {.work = stay, .done = went}};
    struct asker early = {.look.done = on_told}, late = {.look.done = on_told};
    sem_init(&visit.go, 0, 0);
    ls_errands_put(errands, &visit.errand);
    ls_probe_look(probe, &early.look);
    g_assert_true(early.told); /* at once, with nothing */
    g_assert_cmpint(silent_visits(&silent), ==, 0);
    sem_post(&visit.go);
    while (!visit.done)
        g_main_context_iteration(NULL, TRUE);
    ls_probe_look(probe, &late.look);
    g_assert_false(late.told);
    ls_probe_turn_away(&late.look);
    probe_end(probe, errands);
    g_assert_false(late.told);
    sem_destroy(&visit.go);
    close(silent.fd);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/probe/a-silent-controller-delays-only-the-first-answer", test_silence);
    g_test_add_func("/probe/a-finding-is-remembered-until-it-is-forgotten", test_memory);
    g_test_add_func("/probe/nobody-is-asked-while-another-errand-has-the-devices", test_others);
    return g_test_run();
}
