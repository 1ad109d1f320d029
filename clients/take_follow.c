#include "clients/take_follow.h"

#include "clients/interrupt.h"
#include "clients/take_text.h"

#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/random.h>
#include <unistd.h>

static volatile sig_atomic_t interrupts; /* the one thing a signal handler can write */

static void on_interrupt(int signal_number)
{
    if (!ls_interrupt_elsewhere(signal_number))
        interrupts++;
}

void ls_take_follow_signals(void)
{
    struct sigaction action = {.sa_handler = on_interrupt};
    sigset_t block;
    sigemptyset(&action.sa_mask);
    sigaction(SIGINT, &action, NULL);
    sigemptyset(&block);
    sigaddset(&block, SIGINT);
    sigprocmask(SIG_BLOCK, &block, NULL); /* it arrives in ls_command_wait, only there */
}

bool ls_take_token(char token[64])
{
    uint8_t random[12];
    if (getrandom(random, sizeof random, 0) != sizeof random)
        return false;
    for (size_t i = 0; i < sizeof random; i++)
        snprintf(token + 2 * i, 3, "%02x", random[i]);
    return true;
}

/* ---- progress bar ---- */

static unsigned columns(void)
{
    struct winsize size;
    if (ioctl(STDERR_FILENO, TIOCGWINSZ, &size) || size.ws_col < 20)
        return 80;
    return size.ws_col;
}

static void left_text(const struct lightstage_take_status *p, char *out, size_t n)
{
    unsigned left = p->steps_planned > p->steps_bound ? p->steps_planned - p->steps_bound : 0;
    double seconds = p->frames_per_second > 0.1 ? left / p->frames_per_second : -1;
    if (seconds < 0)
        snprintf(out, n, "--:-- left");
    else
        snprintf(out, n, "%d:%02d left", (int)(seconds + 0.5) / 60, (int)(seconds + 0.5) % 60);
}

static void draw(const struct lightstage_take_status *p, bool aborting)
{
    char numbers[128], left[32], bar[64];
    unsigned width = columns() > 70 ? columns() - 62 : 8;
    if (p->steps_planned == 0) {
        fprintf(stderr, "\r%s ...\033[K", aborting ? "aborting" : "preparing");
        return;
    }
    left_text(p, left, sizeof left);
    snprintf(numbers, sizeof numbers, "%u/%u  %.1f/s  lost %u%s  %s", p->steps_bound,
             p->steps_planned, p->frames_per_second, p->shots_lost, p->drift_alarm ? "  DRIFT" : "",
             left);
    width = width < sizeof bar ? width : (unsigned)sizeof bar - 1;
    double share = (double)p->steps_bound / p->steps_planned;
    unsigned full = share < 1 ? (unsigned)(share * width) : width;
    memset(bar, '.', width);
    memset(bar, '#', full);
    bar[width] = '\0';
    fprintf(stderr, "\r%s [%s] %s\033[K", aborting ? "aborting" : "taking", bar, numbers);
}

/* ---- following ---- */

struct following {
    struct ls_command_context *context;
    bool aborting, terminal;
    int code; /* to leave with; -1: it goes on */
};

static int print_end(struct ls_command_context *context,
                     const struct lightstage_take_status *status)
{
    if (context->json && !context->quiet)
        ls_command_print_json(ls_take_status_json(status));
    else if (!context->quiet)
        ls_take_status_print(status);
    else
        fprintf(stderr, "%s: %s%s%s\n", status->id, ls_take_state_word(status->state),
                status->message[0] ? ": " : "", status->message);
    if (interrupts > 0)
        return LS_EXIT_INTERRUPTED;
    return status->state == LIGHTSTAGE_TAKE_COMPLETE ? LS_EXIT_OK : LS_EXIT_NO;
}

static int show(const struct lightstage_take_status *status, void *user)
{
    struct following *following = user;
    bool ended =
        status->state != LIGHTSTAGE_TAKE_PREPARING && status->state != LIGHTSTAGE_TAKE_RUNNING;
    if (following->terminal) {
        draw(status, following->aborting);
        fputs(ended ? "\n" : "", stderr);
    }
    if (ended)
        following->code = print_end(following->context, status);
    return 0;
}

static int lost(struct ls_command_context *context, const char *token)
{
    fprintf(stderr,
            "lightstagectl: %s; the take goes on without this program. `lightstagectl status` "
            "says where it stands; the same command with --token %s follows it again\n",
            context->diag.text, token);
    return LS_EXIT_UNREACHABLE;
}

/* What a signal asks for. Returns an exit code, or -1 to go on. */
static int heed_interrupt(struct following *following)
{
    uint32_t request;
    if (interrupts >= 2) {
        fputs("\nlightstagectl: leaving; the daemon finishes aborting the take\n", stderr);
        return LS_EXIT_INTERRUPTED;
    }
    if (interrupts == 1 && !following->aborting) {
        following->aborting = true;
        fputs("\naborting; waiting for the lights to be dark (Ctrl-C again leaves at once)\n",
              stderr);
        (void)lightstage_take_abort_begin(following->context->stage, &request, NULL);
    }
    return -1;
}

static enum ls_err follow(struct following *following, const char *token)
{
    struct ls_command_context *context = following->context;
    uint32_t request = 0;
    enum ls_err err = ls_command_said(
        context, lightstage_take_progress_begin(context->stage, token, show, following, &request,
                                                &context->error));
    if (err)
        return err;
    do {
        following->code = heed_interrupt(following);
        err = following->code < 0 ? ls_command_wait(context, request) : LS_OK;
    } while (err == LS_ERR_ABORTED);
    return err;
}

int ls_take_follow(struct ls_command_context *context, const char *token)
{
    struct following following = {.context = context, .terminal = isatty(STDERR_FILENO)};
    enum ls_err err = follow(&following, token);
    if (err && following.terminal)
        fputc('\n', stderr);
    if (err == LS_ERR_GONE)
        return lost(context, token);
    if (err)
        return ls_command_failed(context, err);
    return following.code < 0 ? LS_EXIT_NO : following.code; /* -1: it ended without an end */
}
