/* Stored tiles to 64 clients at once over Unix sockets: what they get together against what one
 * gets alone; the longest any of them takes against the shortest; and beside it nginx, sending the
 * same pictures as files to 64 clients on such a socket, where it is installed. */
#include "tests/bench/bench.h"
#include "tests/bench/serving.h"

#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

enum { MOST_CLIENTS = 64, LIGHTS_EACH = 3 };

struct setting {
    const struct bench *bench;
    struct serving serving;
    uint32_t n_clients;
    struct client {
        struct setting *setting;
        struct receiver receiver;
        uint32_t lights[LIGHTS_EACH];
        double took_s;
        int http;
    } clients[MOST_CLIENTS];
    pthread_barrier_t start;
    double fairness; /* of the round with the best one */
    pid_t nginx;
    char *nginx_socket;
};

static double now_s(void)
{
    return 1e-6 * (double)g_get_monotonic_time();
}

/* ---- the daemon's clients ---- */

static void fetch_some(struct client *c)
{
    Lightstage__Fetch fetch;
    stored_fetch(&fetch, &c->setting->serving);
    fetch.lights = c->lights;
    fetch.n_lights = LIGHTS_EACH;
    receive_all(&c->receiver, &fetch);
}

static void *fetch_with_others(void *data)
{
    struct client *c = data;
    pthread_barrier_wait(&c->setting->start);
    double begun = now_s();
    fetch_some(c);
    c->took_s = now_s() - begun;
    return NULL;
}

static void at_once(struct setting *s, void *(*work)(void *client))
{
    pthread_t threads[MOST_CLIENTS];
    for (uint32_t i = 0; i < s->n_clients; i++)
        if (pthread_create(&threads[i], NULL, work, &s->clients[i]))
            abort();
    for (uint32_t i = 0; i < s->n_clients; i++)
        pthread_join(threads[i], NULL);
}

static void serve_many(void *data)
{
    struct setting *s = data;
    double shortest = INFINITY, longest = 0;
    at_once(s, fetch_with_others);
    for (uint32_t i = 0; i < s->n_clients; i++) {
        shortest = fmin(shortest, s->clients[i].took_s);
        longest = fmax(longest, s->clients[i].took_s);
    }
    s->fairness = fmin(s->fairness, longest / shortest);
}

/* As many bytes, one client after the other. */
static void serve_one(void *data)
{
    struct setting *s = data;
    for (uint32_t i = 0; i < s->n_clients; i++) {
        memcpy(s->clients[0].lights, s->clients[i].lights, sizeof s->clients[0].lights);
        fetch_some(&s->clients[0]);
    }
}

/* ---- nginx ---- */

static void connect_http(struct client *c)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    g_strlcpy(address.sun_path, c->setting->nginx_socket, sizeof address.sun_path);
    c->http = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    for (int tries = 0; connect(c->http, (struct sockaddr *)&address, sizeof address); tries++) {
        if (tries == 500) {
            fprintf(stderr, "nginx does not listen on %s\n", address.sun_path);
            exit(1);
        }
        g_usleep(10000); /* it tells nobody when it does */
    }
}

/* Headers come byte by byte: they are few. */
static size_t content_length(int fd)
{
    char head[4096];
    size_t n = 0;
    do
        receive_bytes(fd, head + n++, 1);
    while (n < sizeof head - 1 && (n < 4 || memcmp(head + n - 4, "\r\n\r\n", 4) != 0));
    head[n] = 0;
    const char *length = strstr(head, "Content-Length: ");
    if (strncmp(head, "HTTP/1.1 200", 12) != 0 || !length) {
        fprintf(stderr, "nginx: %.40s\n", head);
        exit(1);
    }
    return strtoul(length + 16, NULL, 10);
}

static void *get_with_others(void *data)
{
    struct client *c = data;
    pthread_barrier_wait(&c->setting->start);
    for (int k = 0; k < LIGHTS_EACH; k++) {
        char *get =
            g_strdup_printf("GET /cam0/W-%04u.exr HTTP/1.1\r\nHost: x\r\n\r\n", c->lights[k]);
        if (send(c->http, get, strlen(get), MSG_NOSIGNAL) != (ssize_t)strlen(get))
            exit(1);
        g_free(get);
        for (size_t left = content_length(c->http), n; left > 0; left -= n) {
            n = left < c->receiver.capacity ? left : c->receiver.capacity;
            receive_bytes(c->http, c->receiver.bytes, n);
        }
    }
    return NULL;
}

static void nginx_many(void *data)
{
    at_once(data, get_with_others);
}

static bool start_nginx(struct setting *s)
{
    char *program = g_find_program_in_path("nginx");
    const char *folder = s->serving.stage.folder;
    if (!program && g_file_test("/usr/sbin/nginx", G_FILE_TEST_IS_EXECUTABLE))
        program = g_strdup("/usr/sbin/nginx");
    if (!program)
        return false;
    char *path = g_build_filename(folder, "nginx.conf", NULL);
    s->nginx_socket = g_build_filename(folder, "nginx", NULL);
    char *conf = g_strdup_printf(
        "%sdaemon off;\nworker_processes %u;\npid %s/nginx.pid;\nerror_log /dev/null;\n"
        "events { worker_connections 512; }\nhttp {\n access_log off;\n sendfile on;\n"
        " client_body_temp_path %s;\n proxy_temp_path %s;\n fastcgi_temp_path %s;\n "
        "uwsgi_temp_path %s;\n scgi_temp_path %s;\n"
        " server { listen unix:%s; root %s/%s; }\n}\n",
        geteuid() == 0 ? "user root;\n" : "", g_get_num_processors(), folder, folder, folder,
        folder, folder, folder, s->nginx_socket, s->serving.stage.storage, s->serving.id);
    if (!g_file_set_contents(path, conf, -1, NULL))
        exit(1);
    s->nginx = fork();
    if (s->nginx == 0) {
        prctl(PR_SET_PDEATHSIG, SIGTERM); /* this program may end without a word */
        execl(program, program, "-p", folder, "-c", path, "-e", "/dev/null", (char *)NULL);
        _exit(127);
    }
    g_free(conf);
    g_free(path);
    g_free(program);
    return true;
}

static void stop_nginx(struct setting *s)
{
    kill(s->nginx, SIGTERM);
    waitpid(s->nginx, NULL, 0);
    g_free(s->nginx_socket);
}

/* ---- rows ---- */

static void print(const struct setting *s, const char *name, const struct bench_task *task,
                  const char *reference, const struct bench_task *other, double wanted)
{
    double bytes = 2.0 * s->serving.side * s->serving.side * LIGHTS_EACH * s->n_clients;
    bench_row(s->bench, &(struct bench_row){.name = name,
                                            .unit = "GB/s",
                                            .value = 1e-9 * bytes / task->best_s,
                                            .median = 1e-9 * bytes / task->median_s,
                                            .error = NAN,
                                            .reference = reference,
                                            .reference_value = 1e-9 * bytes / other->best_s,
                                            .ratio = other->best_s / task->best_s,
                                            .wanted = wanted});
}

static void clients_open(struct setting *s)
{
    for (uint32_t i = 0; i < s->n_clients; i++) {
        struct client *c = &s->clients[i];
        c->setting = s;
        for (uint32_t k = 0; k < LIGHTS_EACH; k++)
            c->lights[k] = (LIGHTS_EACH * i + k) % s->serving.n_lights;
        receiver_open(&c->receiver, &s->serving);
        if (s->nginx)
            connect_http(c);
    }
}

int main(int argc, char **argv)
{
    static struct setting s;
    struct bench bench;
    bench_init(&bench, argc, argv);
    s.bench = &bench;
    s.fairness = INFINITY;
    s.n_clients = (uint32_t)bench_size(&bench, MOST_CLIENTS, 8);
    serving_open(&s.serving, (uint32_t)bench_size(&bench, 24, 4),
                 (uint32_t)bench_size(&bench, 2048, 192), MOST_CLIENTS);
    pthread_barrier_init(&s.start, NULL, s.n_clients);
    bool beside = start_nginx(&s);
    clients_open(&s);
    struct bench_task tasks[] = {{.name = "one client", .run = serve_one, .data = &s},
                                 {.name = "all clients", .run = serve_many, .data = &s},
                                 {.name = "nginx, all clients", .run = nginx_many, .data = &s}};
    bench_time(&bench, tasks, beside ? 3 : 2);
    print(&s, "serve_64", &tasks[1], "one client", &tasks[0], 0.8);
    bench_row(&bench, &(struct bench_row){.name = "serve_64_fairness",
                                          .unit = "longest to shortest",
                                          .value = s.fairness,
                                          .median = s.fairness,
                                          .error = NAN,
                                          .reference = "all alike",
                                          .reference_value = 1,
                                          .ratio = s.fairness,
                                          .wanted = 2,
                                          .at_most = true});
    if (beside) {
        print(&s, "serve_64_nginx", &tasks[1], "nginx, the same pictures as files", &tasks[2], NAN);
        stop_nginx(&s);
    } else {
        printf("# nginx is not installed: tests/packages.extra\n");
    }
    for (uint32_t i = 0; i < s.n_clients; i++) {
        receiver_close(&s.clients[i].receiver);
        if (beside)
            close(s.clients[i].http);
    }
    pthread_barrier_destroy(&s.start);
    serving_close(&s.serving);
    return 0;
}
