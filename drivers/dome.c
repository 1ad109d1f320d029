#include "drivers/dome.h"

#include "drivers/lights_image.h"

#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { STUCK_MS = 120000, WAIT_MS = 5 };

struct ls_dome {
    struct ls_link *link; /* owned */
    struct ls_lights_info info;
    uint32_t boot;       /* of the controller we armed */
    uint16_t arm;        /* its count of arms, then */
    bool armed;          /* boot and arm must hold from now on */
    uint32_t granted;    /* since arm */
    bool ours;           /* armed from here and not blanked since */
    uint32_t next_event; /* sequence number */
};

static enum ls_err identify(struct ls_dome *dome, struct ls_lights_info *info, struct ls_diag *diag)
{
    uint16_t identity[LS_WIRE_IDENTITY_SIZE], limits[LS_WIRE_LIMITS_SIZE];
    enum ls_err err =
        dome->link->ops->read(dome->link, LS_WIRE_IDENTITY, LS_WIRE_IDENTITY_SIZE, identity, diag);
    if (!err)
        err = dome->link->ops->read(dome->link, LS_WIRE_LIMITS, LS_WIRE_LIMITS_SIZE, limits, diag);
    return err ? err : ls_wire_decode_info(identity, limits, info, diag);
}

static enum ls_err check_arm(const struct ls_dome *dome, const uint16_t *status,
                             struct ls_diag *diag)
{
    if (!dome->armed)
        return LS_OK;
    if (ls_wire_get32(status + LS_WIRE_ST_BOOT) != dome->boot)
        return ls_fail(diag, LS_ERR_MISMATCH,
                       "controller %s was restarted: its program and events are gone; load again",
                       dome->info.serial);
    if (status[LS_WIRE_ST_ARM] != dome->arm)
        return ls_fail(diag, LS_ERR_MISMATCH,
                       "controller %s was armed by somebody else: only one host may drive it",
                       dome->info.serial);
    return LS_OK;
}

static enum ls_err read_status(struct ls_dome *dome, uint16_t *status, struct ls_diag *diag)
{
    enum ls_err err =
        dome->link->ops->read(dome->link, LS_WIRE_STATUS, LS_WIRE_STATUS_SIZE, status, diag);
    return err ? err : check_arm(dome, status, diag);
}

/** Connected to the controller we opened, armed as we armed it. */
static enum ls_err ensure(struct ls_dome *dome, struct ls_diag *diag)
{
    if (dome->link->connected)
        return LS_OK;
    struct ls_lights_info info;
    uint16_t status[LS_WIRE_STATUS_SIZE];
    enum ls_err err = dome->link->ops->connect(dome->link, diag);
    if (!err)
        err = identify(dome, &info, diag);
    if (!err && memcmp(&info, &dome->info, sizeof info))
        err = ls_fail(diag, LS_ERR_MISMATCH,
                      "after reconnecting, controller %s answers as %s, or with other limits: "
                      "expected the one opened",
                      dome->info.serial, info.serial);
    if (!err)
        err = read_status(dome, status, diag);
    if (err && dome->link->connected)
        dome->link->ops->disconnect(dome->link);
    return err;
}

static bool is_lost(enum ls_err err)
{
    return err == LS_ERR_TIMEOUT || err == LS_ERR_GONE;
}

/** A write that may be repeated after a lost link. */
static enum ls_err write_again(struct ls_dome *dome, unsigned address, unsigned n,
                               const uint16_t *regs, struct ls_diag *diag)
{
    enum ls_err err = LS_ERR_GONE;
    for (int attempt = 0; attempt < 2 && is_lost(err); attempt++) {
        err = ensure(dome, diag);
        if (!err)
            err = dome->link->ops->write(dome->link, address, n, regs, diag);
    }
    return err;
}

/** A link that is not connected was refused by the host, not by the controller. */
static enum ls_err explain(struct ls_dome *dome, enum ls_err err, const char *doing,
                           struct ls_diag *diag)
{
    uint16_t status[LS_WIRE_STATUS_SIZE];
    if (err != LS_ERR_REFUSED || !dome->link->connected)
        return err;
    enum ls_err read = read_status(dome, status, diag);
    return read ? read : ls_wire_refused(status, doing, diag);
}

static enum ls_err command(struct ls_dome *dome, enum ls_wire_command value, const char *doing,
                           struct ls_diag *diag)
{
    uint16_t reg = (uint16_t)value;
    enum ls_err err = ensure(dome, diag);
    if (!err)
        err =
            dome->link->ops->write(dome->link, LS_WIRE_CONTROL + LS_WIRE_CT_COMMAND, 1, &reg, diag);
    return explain(dome, err, doing, diag);
}

void ls_dome_close(struct ls_dome *dome)
{
    if (dome->link->connected && dome->ours) {
        uint16_t reg = LS_WIRE_BLANK;
        (void)!dome->link->ops->write(dome->link, LS_WIRE_CONTROL + LS_WIRE_CT_COMMAND, 1, &reg,
                                      NULL);
    }
    dome->link->ops->destroy(dome->link);
    free(dome);
}

enum ls_err ls_dome_open(struct ls_link *link, struct ls_dome **out, struct ls_diag *diag)
{
    *out = NULL;
    struct ls_dome *dome = calloc(1, sizeof *dome);
    if (!dome) {
        link->ops->destroy(link);
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    }
    dome->link = link;
    enum ls_err err = link->ops->connect(link, diag);
    if (!err)
        err = identify(dome, &dome->info, diag);
    if (err)
        ls_dome_close(dome);
    else
        *out = dome;
    return err;
}

const struct ls_lights_info *ls_dome_info(const struct ls_dome *dome)
{
    return &dome->info;
}

static enum ls_err clear_faults(struct ls_dome *dome, struct ls_diag *diag)
{
    uint16_t status[LS_WIRE_STATUS_SIZE];
    enum ls_err err = ensure(dome, diag);
    if (!err)
        err = read_status(dome, status, diag);
    if (err)
        return err;
    if (status[LS_WIRE_ST_STATE] == LS_WIRE_ARMED)
        return ls_fail(diag, LS_ERR_STATE, "controller %s is armed: blank it before loading",
                       dome->info.serial);
    if (status[LS_WIRE_ST_STATE] != LS_WIRE_FAULT)
        return LS_OK;
    return command(dome, LS_WIRE_CLEAR_FAULTS, "clearing faults", diag);
}

static enum ls_err upload(struct ls_dome *dome, const uint16_t *image, size_t n,
                          struct ls_diag *diag)
{
    uint16_t window[LS_WIRE_WINDOW_SIZE];
    enum ls_err err = LS_OK;
    for (size_t at = 0; !err && at < n; at += LS_WIRE_WINDOW_DATA) {
        size_t part = n - at < LS_WIRE_WINDOW_DATA ? n - at : LS_WIRE_WINDOW_DATA;
        ls_wire_put32(window + LS_WIRE_WN_ADDRESS, (uint32_t)at);
        window[LS_WIRE_WN_LENGTH] = (uint16_t)part;
        memcpy(window + LS_WIRE_WN_DATA, image + at, 2 * part);
        err = dome->link->ops->write(dome->link, LS_WIRE_WINDOW, LS_WIRE_WN_DATA + (unsigned)part,
                                     window, diag);
    }
    return explain(dome, err, "uploading", diag);
}

static enum ls_err announce(struct ls_dome *dome, const struct ls_program *program,
                            const uint16_t *image, size_t n, struct ls_diag *diag)
{
    uint16_t regs[8], back[LS_WIRE_IMAGE_CRC_SIZE];
    uint32_t crc = ls_wire_crc32c(image, n);
    ls_wire_put32(regs, (uint32_t)(2 * n));
    ls_wire_put32(regs + 2, crc);
    ls_wire_put32(regs + 4, program->n_conditions);
    ls_wire_put32(regs + 6, program->n_steps);
    enum ls_err err =
        dome->link->ops->write(dome->link, LS_WIRE_CONTROL + LS_WIRE_CT_BYTES, 8, regs, diag);
    if (!err)
        err = dome->link->ops->read(dome->link, LS_WIRE_IMAGE_CRC, LS_WIRE_IMAGE_CRC_SIZE, back,
                                    diag);
    if (err)
        return explain(dome, err, "announcing the program", diag);
    if (ls_wire_get32(back) != crc)
        return ls_fail(diag, LS_ERR_MISMATCH,
                       "the program in controller %s has CRC %08x: expected %08x; it was damaged "
                       "on the way: load again",
                       dome->info.serial, ls_wire_get32(back), crc);
    return LS_OK;
}

static void pause_ms(unsigned ms)
{
    nanosleep(&(struct timespec){.tv_sec = ms / 1000, .tv_nsec = ms % 1000 * 1000000L}, NULL);
}

/* until the controller is not getting ready any more, for this program or one given up before; it
 * cannot tell on its own, so it is asked every WAIT_MS */
static enum ls_err wait_prepared(struct ls_dome *dome, const _Atomic bool *stop,
                                 uint16_t status[LS_WIRE_STATUS_SIZE], struct ls_diag *diag)
{
    uint16_t progress = 0;
    uint64_t moved_ns = ls_link_now_ns();
    for (;;) {
        enum ls_err err = ensure(dome, diag);
        if (!err)
            err = read_status(dome, status, diag);
        if (err || status[LS_WIRE_ST_STATE] != LS_WIRE_PREPARING)
            return err;
        if (stop && atomic_load(stop))
            return ls_fail(diag, LS_ERR_ABORTED, "stopped while controller %s got ready",
                           dome->info.serial);
        if (status[LS_WIRE_ST_PROGRESS] != progress)
            moved_ns = ls_link_now_ns();
        progress = status[LS_WIRE_ST_PROGRESS];
        if (ls_link_now_ns() - moved_ns > STUCK_MS * 1000000ull)
            return ls_fail(diag, LS_ERR_TIMEOUT,
                           "controller %s stands at %u permille of getting ready since %u s",
                           dome->info.serial, progress, STUCK_MS / 1000);
        pause_ms(WAIT_MS);
    }
}

static enum ls_err wait_ready(struct ls_dome *dome, const _Atomic bool *stop, struct ls_diag *diag)
{
    uint16_t status[LS_WIRE_STATUS_SIZE];
    enum ls_err err = wait_prepared(dome, stop, status, diag);
    if (!err && status[LS_WIRE_ST_STATE] != LS_WIRE_LOADED)
        err = ls_wire_refused(status, "preparing the program", diag);
    return err;
}

enum ls_err ls_dome_load(struct ls_dome *dome, const struct ls_program *program,
                         const _Atomic bool *stop, struct ls_diag *diag)
{
    uint16_t status[LS_WIRE_STATUS_SIZE];
    dome->armed = false;
    enum ls_err err = wait_prepared(dome, stop, status, diag);
    if (!err)
        err = clear_faults(dome, diag);
    if (err)
        return err;
    LS_CLEANUP_FREE uint16_t *image = calloc(ls_image_registers(program), sizeof *image);
    if (!image)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    size_t n = ls_image_encode(program, image);
    err = upload(dome, image, n, diag);
    if (!err)
        err = announce(dome, program, image, n, diag);
    if (!err)
        err = command(dome, LS_WIRE_COMMIT, "committing the program", diag);
    return err ? err : wait_ready(dome, stop, diag);
}

enum ls_err ls_dome_arm(struct ls_dome *dome, struct ls_diag *diag)
{
    uint16_t status[LS_WIRE_STATUS_SIZE];
    dome->armed = false;
    enum ls_err err = ensure(dome, diag);
    if (!err)
        err = read_status(dome, status, diag);
    if (err)
        return err;
    if (status[LS_WIRE_ST_STATE] == LS_WIRE_IDLE || status[LS_WIRE_ST_STATE] == LS_WIRE_PREPARING)
        return ls_fail(diag, LS_ERR_STATE, "controller %s has no program: load before arming",
                       dome->info.serial);
    dome->ours = true;
    err = command(dome, LS_WIRE_ARM, "arming", diag);
    if (!err)
        err = read_status(dome, status, diag);
    if (err)
        return err;
    dome->boot = ls_wire_get32(status + LS_WIRE_ST_BOOT);
    dome->arm = status[LS_WIRE_ST_ARM];
    dome->armed = true;
    dome->next_event = dome->granted = 0;
    return LS_OK;
}

enum ls_err ls_dome_grant(struct ls_dome *dome, uint32_t n_steps, struct ls_diag *diag)
{
    uint16_t regs[2], release = LS_WIRE_RELEASE;
    ls_wire_put32(regs, n_steps);
    enum ls_err err =
        n_steps == dome->granted
            ? write_again(dome, LS_WIRE_CONTROL + LS_WIRE_CT_COMMAND, 1, &release, diag)
            : write_again(dome, LS_WIRE_CONTROL + LS_WIRE_CT_GRANT, 2, regs, diag);
    if (!err && n_steps > dome->granted)
        dome->granted = n_steps;
    return explain(dome, err, "granting steps", diag);
}

/** One round trip: acknowledge what was read, read the status and up to 9 events. */
static enum ls_err exchange(struct ls_dome *dome, uint16_t *regs, struct ls_lights_status *status,
                            struct ls_diag *diag)
{
    uint16_t ack[2];
    ls_wire_put32(ack, dome->next_event);
    enum ls_err err = LS_ERR_GONE;
    for (int attempt = 0; attempt < 2 && is_lost(err); attempt++) {
        err = ensure(dome, diag);
        if (!err)
            err = dome->link->ops->write_read(dome->link, LS_WIRE_CONTROL + LS_WIRE_CT_ACK, 2, ack,
                                              LS_WIRE_STATUS, LS_WIRE_STATUS_SIZE, regs, diag);
    }
    if (!err)
        err = check_arm(dome, regs, diag);
    if (!err)
        ls_wire_decode_status(regs, status);
    status->host_before_ns = dome->link->before_ns;
    status->host_after_ns = dome->link->after_ns;
    return explain(dome, err, "reading status", diag);
}

/** The event due next: it is in the status block @regs, or the controller has sent it unasked. */
static bool next_event(struct ls_dome *dome, const uint16_t *regs, struct ls_step_event *event)
{
    uint16_t sent[LS_WIRE_EVENT_SIZE];
    uint32_t at = dome->next_event - ls_wire_get32(regs + LS_WIRE_ST_EVENT_FIRST);
    uint32_t n = regs[LS_WIRE_ST_EVENT_COUNT];
    const struct ls_link_ops *ops = dome->link->ops;
    if (at < n && at < LS_WIRE_EVENTS_PER_READ)
        ls_wire_decode_event(regs + LS_WIRE_ST_EVENTS + at * LS_WIRE_EVENT_SIZE, event);
    else if (dome->armed && ops->take_event &&
             ops->take_event(dome->link, dome->boot, dome->arm, dome->next_event, sent))
        ls_wire_decode_event(sent, event);
    else
        return false;
    dome->next_event++;
    return true;
}

/** Overwritten before they were read, or another host's: go on with the first there is. */
static void skip_lost(struct ls_dome *dome, const uint16_t *regs)
{
    uint32_t first = ls_wire_get32(regs + LS_WIRE_ST_EVENT_FIRST);
    if (regs[LS_WIRE_ST_EVENT_COUNT] && (int32_t)(first - dome->next_event) > 0)
        dome->next_event = first;
}

enum ls_err ls_dome_poll(struct ls_dome *dome, struct ls_lights_status *status,
                         struct ls_step_event *events, size_t max_events, size_t *n_events,
                         struct ls_diag *diag)
{
    uint16_t regs[LS_WIRE_STATUS_SIZE];
    size_t n = 0, before;
    uint32_t known;
    do {
        enum ls_err err = exchange(dome, regs, status, diag);
        if (err)
            return n ? LS_OK : err;
        before = n;
        skip_lost(dome, regs);
        while (n < max_events && next_event(dome, regs, &events[n]))
            n++;
        *n_events = n;
        known = ls_wire_get32(regs + LS_WIRE_ST_EVENT_FIRST) + regs[LS_WIRE_ST_EVENT_PENDING];
    } while (n < max_events && n > before && (int32_t)(known - dome->next_event) > 0);
    return LS_OK;
}

enum ls_err ls_dome_blank(struct ls_dome *dome, struct ls_diag *diag)
{
    uint16_t reg = LS_WIRE_BLANK;
    dome->armed = false;
    enum ls_err err = write_again(dome, LS_WIRE_CONTROL + LS_WIRE_CT_COMMAND, 1, &reg, diag);
    dome->ours = dome->ours && err;
    return err;
}

enum ls_err ls_dome_set_work(struct ls_dome *dome, uint16_t channel, uint16_t level,
                             struct ls_diag *diag)
{
    const uint16_t regs[2] = {channel, level};
    enum ls_err err = write_again(dome, LS_WIRE_CONTROL + LS_WIRE_CT_WORK, 2, regs, diag);
    return explain(dome, err, "setting the work light", diag);
}

static enum ls_err switch_on(struct ls_dome *dome, uint16_t command, struct ls_diag *diag)
{
    enum ls_err err = write_again(dome, LS_WIRE_CONTROL + LS_WIRE_CT_COMMAND, 1, &command, diag);
    return explain(dome, err, "switching on the work light", diag);
}

enum ls_err ls_dome_work(struct ls_dome *dome, struct ls_diag *diag)
{
    return switch_on(dome, LS_WIRE_WORK, diag);
}

enum ls_err ls_dome_steady(struct ls_dome *dome, struct ls_diag *diag)
{
    return switch_on(dome, LS_WIRE_STEADY, diag);
}
