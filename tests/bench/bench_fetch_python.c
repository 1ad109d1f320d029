/* Stored pictures into numpy arrays by the Python package, in tiles and in rows; held against the C
 * client that drops what it receives (serve_stored). */
#include "tests/bench/bench.h"
#include "tests/bench/serving.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

struct setting {
    struct serving serving;
    struct receiver client;
    Lightstage__Fetch stored;
    pid_t child;
    FILE *say, *hear;
};

static void serve_stored(void *data)
{
    struct setting *s = data;
    receive_all(&s->client, &s->stored);
}

static void start_python(struct setting *s)
{
    int to[2], from[2];
    if (pipe(to) || pipe(from))
        abort();
    s->child = fork();
    if (s->child == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        dup2(to[0], STDIN_FILENO);
        dup2(from[1], STDOUT_FILENO);
        close(to[1]);
        close(from[0]);
        execl("/usr/bin/python3", "python3", "-B", BENCH_SOURCE "/fetch_python.py",
              BENCH_BUILD "/clients/python", s->serving.stage.socket_path, s->serving.id,
              (char *)NULL);
        _exit(127);
    }
    close(to[0]);
    close(from[1]);
    s->say = fdopen(to[1], "w");
    s->hear = fdopen(from[0], "r");
}

static void python(struct setting *s, const char *word)
{
    char line[16];
    fprintf(s->say, "%s\n", word);
    if (fflush(s->say) || !fgets(line, sizeof line, s->hear) || strcmp(line, "done\n") != 0) {
        fprintf(stderr, "the Python client has ended\n");
        exit(1);
    }
}

static void python_tiles(void *data)
{
    python(data, "tiles");
}

static void python_rows(void *data)
{
    python(data, "rows");
}

static void print(const struct bench *bench, const char *name, const struct bench_task *task,
                  const struct bench_task *c, double bytes, double wanted)
{
    bench_row(bench, &(struct bench_row){.name = name,
                                         .unit = "GB/s",
                                         .value = 1e-9 * bytes / task->best_s,
                                         .median = 1e-9 * bytes / task->median_s,
                                         .error = NAN,
                                         .reference = "serve_stored",
                                         .reference_value = 1e-9 * bytes / c->best_s,
                                         .ratio = c->best_s / task->best_s,
                                         .wanted = wanted});
}

int main(int argc, char **argv)
{
    struct bench bench;
    struct setting s;
    bench_init(&bench, argc, argv);
    serving_open(&s.serving, (uint32_t)bench_size(&bench, 24, 4),
                 (uint32_t)bench_size(&bench, 2048, 192), 8);
    receiver_open(&s.client, &s.serving);
    stored_fetch(&s.stored, &s.serving);
    start_python(&s);
    struct bench_task tasks[] = {{.name = "stored tiles, C", .run = serve_stored, .data = &s},
                                 {.name = "stored tiles, Python", .run = python_tiles, .data = &s},
                                 {.name = "stored rows, Python", .run = python_rows, .data = &s}};
    bench_time(&bench, tasks, 3);
    double bytes = 2.0 * s.serving.side * s.serving.side * s.serving.n_lights;
    print(&bench, "fetch_python", &tasks[1], &tasks[0], bytes, 0.5);
    print(&bench, "fetch_python_rows", &tasks[2], &tasks[0], bytes, NAN);
    fclose(s.say);
    waitpid(s.child, NULL, 0);
    fclose(s.hear);
    receiver_close(&s.client);
    serving_close(&s.serving);
    return 0;
}
