/*
 * lightstage-render: a take and a sequence of environments, to relit OpenEXR frames. Connects,
 * starts the workers, shows how far they are, and says what came of it.
 */
#include "clients/render_serve.h"
#include "clients/render_work.h"

#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

const struct ls_command ls_command_render = {
    "",
    "A take under a sequence of environments, as OpenEXR frames. Frames that are whole and of the "
    "same\nlight are left as they are: a run that was interrupted goes on where it was",
    "TAKE ENVIRONMENT... --output FOLDER/NAME.%04d.exr\n"
    "         [--frames FIRST-LAST[xSTEP]] [--rotate FROM,TO] [--jobs N] [--again] [--quiet]\n"
    "         [--socket PATH | --server tls://HOST:PORT --certificate FILE --key FILE\n"
    "         --authority FILE] [--raw] [--space rec709-linear|camera-raw]\n" LS_RELIGHT_SOLVE_USAGE
        LS_PROMOTION_USAGE
    "         [--region X,Y,WIDTH,HEIGHT] [--level 0|1|2] [--max-error E] [--camera N]\n"
    "         [--json] [--version]\n"
    "TAKE: the name of a take of the daemon, or a take's folder, which needs none.\n"
    "ENVIRONMENT: as of lightstagectl relight. sky.%04d.exr is one for each of --frames, one\n"
    "without a number is the same for all of them, several are a frame each",
    NULL};

static _Atomic bool stop;

/* The second one ends the program. */
static void on_interrupt(int number)
{
    atomic_store(&stop, true);
    signal(number, SIG_DFL);
}

static double now_s(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* ---- how far ---- */

static void show(const struct ls_render_work *work, double begun_s, bool last)
{
    const struct ls_render_options *options = work->options;
    double seconds = now_s() - begun_s;
    if (options->quiet || !isatty(STDERR_FILENO))
        return;
    fprintf(stderr, "\r%u of %u frames, %u were there, %.1f frames/s %s", work->made + work->kept,
            options->frames.n, work->kept, seconds > 0 ? work->made / seconds : 0,
            last ? "\n" : "");
}

/* Until nobody runs any more; a line for a terminal about five times a second. */
static void watch(struct ls_render_work *work, double begun_s)
{
    pthread_mutex_lock(&work->lock);
    while (work->running > 0) {
        struct timespec until;
        clock_gettime(CLOCK_REALTIME, &until);
        until.tv_nsec += 200000000;
        until.tv_sec += until.tv_nsec / 1000000000;
        until.tv_nsec %= 1000000000;
        while (work->running > 0 &&
               pthread_cond_timedwait(&work->changed, &work->lock, &until) != ETIMEDOUT)
            ;
        show(work, begun_s, work->running == 0);
    }
    pthread_mutex_unlock(&work->lock);
}

static void report(const struct ls_command_context *context, const struct ls_render_work *work,
                   double seconds)
{
    uint32_t n = work->options->frames.n;
    if (context->json)
        ls_command_print_json(json_pack("{si si si sf}", "frames", (int)n, "made", (int)work->made,
                                        "kept", (int)work->kept, "seconds", seconds));
    else if (!work->options->quiet)
        printf("%u frames: %u made, %u were there; %.1f s\n", n, work->made, work->kept, seconds);
}

/* ---- the work ---- */

/* Connections first, so that workers only work. */
static int connect_all(struct ls_render_worker *workers, uint32_t n, struct ls_render_work *work,
                       const struct ls_command_context *context)
{
    int code = LS_EXIT_OK;
    for (uint32_t i = 0; i < n && !code; i++) {
        workers[i].work = work;
        workers[i].context = *context;
        workers[i].context.stage = NULL;
        code = ls_command_open(&workers[i].context);
    }
    return code;
}

static int run_workers(struct ls_render_worker *workers, uint32_t n, struct ls_render_work *work)
{
    double begun_s = now_s();
    uint32_t started = 0;
    work->running = n;
    while (started < n &&
           !pthread_create(&workers[started].thread, NULL, ls_render_worker_run, &workers[started]))
        started++;
    pthread_mutex_lock(&work->lock);
    work->running -= n - started;
    pthread_mutex_unlock(&work->lock);
    watch(work, begun_s);
    for (uint32_t i = 0; i < started; i++)
        pthread_join(workers[i].thread, NULL);
    if (started == 0)
        return ls_command_wrong("cannot start a thread"), LS_EXIT_INTERNAL;
    if (atomic_load(&stop))
        return LS_EXIT_INTERRUPTED;
    if (!work->code)
        report(&workers[0].context, work, now_s() - begun_s);
    return work->code;
}

static int render(struct ls_command_context *context, const struct ls_render_options *options,
                  const struct ls_take_document *document, struct ls_render_serve *serve)
{
    struct ls_render_work work = {.options = options,
                                  .document = document,
                                  .lock = PTHREAD_MUTEX_INITIALIZER,
                                  .changed = PTHREAD_COND_INITIALIZER,
                                  .stop = &stop};
    uint32_t n = options->jobs < options->frames.n ? options->jobs : options->frames.n;
    struct ls_render_worker workers[LS_RENDER_MAX_JOBS] = {{0}};
    int code = connect_all(workers, n, &work, context);
    ls_render_serve_hide(serve);
    if (!code)
        code = run_workers(workers, n, &work);
    for (uint32_t i = 0; i < n; i++)
        lightstage_close(workers[i].context.stage);
    return code;
}

static int run_on(struct ls_command_context *context, struct ls_render_options *options,
                  struct ls_render_serve *serve)
{
    struct ls_take_document *document = NULL;
    bool folder = false;
    enum ls_err err = ls_render_is_folder(options->relight.take, &folder, &context->diag);
    if (folder)
        err = ls_render_serve_start(options->relight.take, serve, &context->diag);
    if (err)
        return ls_command_failed(context, err);
    if (folder) {
        context->socket_path = serve->socket;
        context->server = NULL;
        options->relight.take = serve->take;
    }
    int code =
        ls_take_document_get(context, options->relight.take, options->relight.camera, &document);
    if (!code)
        code = ls_relight_use_profile(&options->relight, document);
    if (!code)
        code = render(context, options, document, serve);
    ls_take_document_destroy(document);
    return code;
}

static int command_line(int argc, char **argv)
{
    struct ls_command_context context = {0};
    struct ls_render_options options = {0};
    struct ls_render_serve serve = {0};
    ls_command_defaults(&context);
    int code = ls_render_options_parse(&context, argc, argv, &options);
    if (!code)
        code = run_on(&context, &options, &serve);
    lightstage_close(context.stage);
    ls_render_serve_stop(&serve);
    ls_render_options_finish(&options);
    return code;
}

int main(int argc, char **argv)
{
    const struct sigaction action = {.sa_handler = on_interrupt};
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    return ls_command_end(command_line(argc, argv));
}
