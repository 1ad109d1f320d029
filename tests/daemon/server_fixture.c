#include "tests/daemon/server_fixture.h"

#include "tests/daemon/store_fixture.h"

#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

static char camera_name[] = "front", rig_name[] = "test rig", white[] = "W", red[] = "R";
static struct ls_config_light lights[2] = {{{0, 1, 0}, 0}, {{0, 0, 1.5f}, 1}};

static void on_take(void *user, const struct ls_take_status *status)
{
    struct stage *stage = user;
    if (stage->server)
        ls_server_take_event(stage->server, status);
}

void stage_init(struct stage *stage)
{
    memset(stage, 0, sizeof *stage);
    stage->folder = new_root();
    stage->socket_path = g_build_filename(stage->folder, "socket", NULL);
    stage->storage = g_build_filename(stage->folder, "takes", NULL);
    g_assert_cmpint(g_mkdir(stage->storage, 0700), ==, 0);
    stage->config.rig_name = rig_name;
    stage->config.n_lights = 2;
    stage->config.lights = lights;
    stage->config.n_channels = 2;
    stage->config.channels[0].name = white;
    stage->config.channels[1].name = red;
    stage->config.n_cameras = 1;
    stage->config.cameras[0].name = camera_name;
    stage->config.cameras[0].focal_length_mm = 50;
}

static gpointer run_loop(gpointer data)
{
    struct stage *stage = data;
    g_main_loop_run(stage->loop);
    return NULL;
}

void stage_open(struct stage *stage)
{
    struct ls_diag diag = {0};
    stage->limits.socket_path = stage->socket_path;
    stage->limits.storage = stage->storage;
    g_assert_cmpint(ls_engine_create(&stage->config, on_take, stage, &stage->engine, &diag), ==,
                    LS_OK);
    enum ls_err err = ls_server_create(&stage->limits, stage->engine, &stage->server, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    stage->loop = g_main_loop_new(NULL, FALSE);
    stage->thread = g_thread_new("ls-main", run_loop, stage);
}

struct errand {
    struct stage *stage;
    void (*verb)(struct stage *stage, void *data);
    void *data;
    GMutex lock;
    GCond done;
    bool is_done;
};

static gboolean run_errand(gpointer data)
{
    struct errand *errand = data;
    errand->verb(errand->stage, errand->data);
    g_mutex_lock(&errand->lock);
    errand->is_done = true;
    g_cond_signal(&errand->done);
    g_mutex_unlock(&errand->lock);
    return G_SOURCE_REMOVE;
}

void stage_do(struct stage *stage, void (*verb)(struct stage *stage, void *data), void *data)
{
    struct errand errand = {.stage = stage, .verb = verb, .data = data};
    g_mutex_init(&errand.lock);
    g_cond_init(&errand.done);
    g_idle_add_full(G_PRIORITY_DEFAULT, run_errand, &errand, NULL);
    g_mutex_lock(&errand.lock);
    while (!errand.is_done)
        g_cond_wait(&errand.done, &errand.lock);
    g_mutex_unlock(&errand.lock);
    g_mutex_clear(&errand.lock);
    g_cond_clear(&errand.done);
}

static void quit(struct stage *stage, void *data)
{
    ls_server_destroy(stage->server);
    stage->server = NULL;
    g_main_loop_quit(stage->loop);
}

void stage_close(struct stage *stage)
{
    stage_do(stage, quit, NULL);
    g_thread_join(stage->thread);
    g_main_loop_unref(stage->loop);
    ls_engine_destroy(stage->engine);
    remove_tree(stage->folder);
    g_free(stage->folder);
    g_free(stage->socket_path);
    g_free(stage->storage);
}

static void advance(struct stage *stage, void *data)
{
    fake_engine_advance(stage->engine, *(uint32_t *)data);
}

void take_advances(struct stage *stage, uint32_t steps)
{
    stage_do(stage, advance, &steps);
}

static void end(struct stage *stage, void *data)
{
    fake_engine_end(stage->engine, *(enum ls_take_state *)data);
}

void take_ends(struct stage *stage, enum ls_take_state state)
{
    stage_do(stage, end, &state);
}

static void get_state(struct stage *stage, void *data)
{
    *(struct fake_engine_state *)data = *fake_engine_state(stage->engine);
}

struct fake_engine_state engine_state(struct stage *stage)
{
    struct fake_engine_state state;
    stage_do(stage, get_state, &state);
    return state;
}

static void silence(struct stage *stage, void *data)
{
    fake_engine_state(stage->engine)->silent = true;
}

void engine_falls_silent(struct stage *stage)
{
    stage_do(stage, silence, NULL);
}

static void set_answer(struct stage *stage, void *data)
{
    fake_engine_state(stage->engine)->answer = *(enum ls_err *)data;
}

void engine_will_answer(struct stage *stage, enum ls_err err)
{
    stage_do(stage, set_answer, &err);
}

static void count(struct stage *stage, void *data)
{
    *(unsigned *)data = ls_server_connections(stage->server);
}

void wait_for_connections(struct stage *stage, unsigned n)
{
    int64_t deadline = g_get_monotonic_time() + 5 * G_TIME_SPAN_SECOND;
    for (unsigned now = n + 1; now != n;) {
        stage_do(stage, count, &now);
        if (g_get_monotonic_time() > deadline)
            g_error("%u clients are connected, expected %u", now, n);
        g_thread_yield();
    }
}

struct ls_connection *a_client(struct stage *stage)
{
    struct ls_connection *client = NULL;
    struct ls_diag diag = {0};
    enum ls_err err = ls_connection_open(stage->socket_path, &client, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    return client;
}

int a_bare_socket(struct stage *stage)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    g_assert_cmpint(fd, >=, 0);
    g_strlcpy(address.sun_path, stage->socket_path, sizeof address.sun_path);
    g_assert_cmpint(connect(fd, (struct sockaddr *)&address, sizeof address), ==, 0);
    return fd;
}
