#include "sim/log.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

struct sim_log {
    int fd; /* -1: none */
    _Atomic int failed;
};

enum ls_err sim_log_open(const char *path, struct sim_log **out, struct ls_diag *diag)
{
    struct sim_log *log = calloc(1, sizeof *log);
    *out = log;
    if (!log)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    log->fd = path[0] ? open(path, O_WRONLY | O_CREAT | O_TRUNC | O_APPEND | O_CLOEXEC, 0666) : -1;
    if (path[0] && log->fd < 0) {
        enum ls_err err = ls_fail(diag, LS_ERR_OS, "log %s: %s", path, strerror(errno));
        free(log);
        *out = NULL;
        return err;
    }
    return LS_OK;
}

static int index_or_none(uint32_t index)
{
    return index == UINT32_MAX ? -1 : (int)index;
}

void sim_log_exposure(struct sim_log *log, const struct sim_exposure *exposure, uint64_t frame_id,
                      uint64_t camera_ns, const struct sim_shown *shown, enum sim_camera_fate fate)
{
    static const char *const kinds[] = {"dark", "one", "sphere", "segment", "list"};
    static const char *const fates[] = {"sent", "dropped_pulse", "lost_frame", "missed_trigger"};
    char line[512];
    if (log->fd < 0)
        return;
    int n = snprintf(
        line, sizeof line,
        "{\"camera\":%u,\"frame_id\":%" PRIu64 ",\"camera_ns\":%" PRIu64 ",\"true_ns\":%" PRIu64
        ",\"exposure_us\":%.3f,\"lit_us\":%.3f,\"step\":%d,\"condition\":%d,\"kind\":\"%s\","
        "\"n_leds\":%u,\"light\":%d,\"channel\":%d,\"duty\":%.6f,\"hash\":\"%08x\","
        "\"fate\":\"%s\"}\n",
        exposure->camera, frame_id, camera_ns, exposure->true_ns, exposure->exposure_us,
        exposure->lit_us, index_or_none(exposure->step), index_or_none(exposure->condition),
        kinds[shown->kind], shown->n_leds, shown->n_leds == 1 ? shown->first.light : -1,
        shown->n_leds ? shown->first.channel : -1, shown->n_leds ? (double)shown->first.duty : -1.0,
        shown->hash, fates[fate]);
    if (write(log->fd, line, (size_t)n) != n && !atomic_exchange(&log->failed, errno ? errno : EIO))
        fprintf(stderr, "lightstage-sim: writing the log: %s\n", strerror(log->failed));
}

enum ls_err sim_log_close(struct sim_log *log, struct ls_diag *diag)
{
    if (!log)
        return LS_OK;
    int failed = log->failed;
    if (log->fd >= 0)
        close(log->fd);
    free(log);
    return failed ? ls_fail(diag, LS_ERR_OS, "the log lost lines: %s", strerror(failed)) : LS_OK;
}
