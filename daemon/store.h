/*
 * store: the take being written: tickets and pictures go in, a durable folder comes out.
 * Layer: daemon. Threads: its own `ls-store` does the disk work; ticket, published, raw and alarm
 * from any normal thread at once (they block while the queue is full: never from ls-seq or
 * ls-cam); create, reopen, set_state, close from one. Ownership: everything passed is copied or
 * encoded before the call returns.
 *
 * A take is a folder `YYYYMMDDThhmmssZ-<name>-<6 hex>/` holding take.json, journal (journal.h),
 * cam<k>/<condition>.exr and, with keep_raw, cam<k>/raw/<shot>-<attempt>.raw. It is locked (flock
 * on the journal) while somebody writes it.
 *
 * What is durable when: a picture's file is written whole under a temporary name, synced and
 * renamed; then its folder is synced, then its journal record and all tickets queued before it are
 * appended and synced together. Syncs of the journal are grouped: one per 50 ms or 16 pictures,
 * whichever comes first, and one per flush. A file without its record does not exist.
 *
 * Files are written past the page cache where the file system lets them (diskio.h,
 * write_buffers.h).
 *
 * Errors of the disk are latched: every later call returns the first one with its sentence, nothing
 * more is written, and the take stays as it was at the last good record. The process ignores
 * SIGXFSZ, so that a limit on file sizes is such an error.
 */
#ifndef LS_DAEMON_STORE_H
#define LS_DAEMON_STORE_H

#include "core/error.h"
#include "core/exr.h"
#include "daemon/diskio.h"
#include "daemon/metrics.h"
#include "daemon/ticket.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { LS_TAKE_FORMAT = 1 };

/** As written in take.json and the journal: "open", "complete", ... */
enum ls_store_state {
    LS_STORE_OPEN,
    LS_STORE_COMPLETE,
    LS_STORE_INCOMPLETE, /* ended; some conditions could not be had */
    LS_STORE_ABORTED,
    LS_STORE_FAILED,
};

/** Never NULL. RT-safe. */
const char *ls_store_state_name(enum ls_store_state state);

/** A new take. Strings are (transfer none). */
struct ls_store_config {
    const char *root;      /* existing folder that holds the takes */
    const char *name;      /* [A-Za-z0-9_-]{1,64} */
    const char *take_json; /* a JSON object: plan, rig, calibration ... see ls_store_create */
    int64_t utc_s;         /* wall time of the take, seconds since 1970 */
    uint32_t n_cameras;
    uint32_t n_shots;              /* planned, of all cameras */
    const char *const *conditions; /* ids of the planned conditions, published per camera */
    uint32_t n_conditions;
    bool keep_raw;
    uint64_t need_bytes;  /* pictures (ls_exr_mosaic_bytes_max) and raw frames; the store adds
                             its journal and take.json */
    uint64_t spare_bytes; /* to be left free on the disk beside that */
    const struct ls_disk_shim *shim; /* tests; NULL */
};

struct ls_store;

/**
 * Make the folder, reserve the space, write take.json, start ls-store.
 *
 * take.json is @take_json plus the keys the store owns, which replace the caller's:
 *   "format" 1, "state", "name", "utc" (ISO 8601), "planned" {"shots", "cameras", "conditions" []},
 *   "missing" [] (ids of conditions, "cam<k>/<id>"), "skips" [], "keep_raw".
 *
 * Errors: LS_ERR_INVALID (name, JSON), LS_ERR_NOT_FOUND (root), LS_ERR_FULL (less than need +
 * spare bytes: the sentence names both and what is free; nothing is left behind), LS_ERR_OS,
 * LS_ERR_NOMEM. *out: (transfer full), ls_store_close.
 */
LS_MUST_CHECK enum ls_err ls_store_create(const struct ls_store_config *config,
                                          struct ls_store **out, struct ls_diag *diag);

/**
 * Go on with the take in @folder: temporary files removed, torn tail of the journal cut off, state
 * "open" again. @need_bytes and @spare_bytes: for what is still to come. What is published already
 * is refused by publish. Errors as create, plus LS_ERR_NOT_FOUND, LS_ERR_BUSY (being written by
 * somebody else), LS_ERR_STATE (complete), LS_ERR_UNSUPPORTED (other format), LS_ERR_INVALID
 * (damaged beyond the torn tail).
 */
LS_MUST_CHECK enum ls_err ls_store_reopen(const char *folder, uint64_t need_bytes,
                                          uint64_t spare_bytes, const struct ls_disk_shim *shim,
                                          struct ls_store **out, struct ls_diag *diag);

/** Memory of waiting work, 256 MiB to begin with; one item always fits. Before anything is queued.
 */
void ls_store_limit_queue(struct ls_store *store, uint64_t bytes);

/** Called on ls-store when a picture is durable and can be read back. */
typedef void ls_store_published(void *user, const char *condition, uint32_t camera);

/** Say so to @published from now on. Before anything is queued. */
void ls_store_tell(struct ls_store *store, ls_store_published *published, void *user);

/** Absolute or as given in root; the last component is the take's id. (transfer none). */
const char *ls_store_folder(const struct ls_store *store);
const char *ls_store_id(const struct ls_store *store);

/** Record a bound shot. Durable no later than the next publication's group commit or 50 ms. */
LS_MUST_CHECK enum ls_err ls_store_ticket(struct ls_store *store, const struct ls_ticket *ticket,
                                          struct ls_diag *diag);

/** A finished condition of one camera: exactly one of half (E x referenceExposure) and floats (mean
 * dark, DN). */
struct ls_store_picture {
    const char *condition; /* id: [A-Za-z0-9_-]{1,63} */
    uint32_t camera;
    struct ls_exr_mosaic mosaic;   /* with its attributes */
    struct ls_picture_times times; /* counted once it is durable */
};

/**
 * Publish a condition. Encodes and checksums on the calling thread, then queues; returns LS_OK when
 * queued. Errors: LS_ERR_EXISTS (published already: decoded values never change), LS_ERR_INVALID
 * (id, camera, sizes), the latched one.
 */
LS_MUST_CHECK enum ls_err ls_store_publish(struct ls_store *store,
                                           const struct ls_store_picture *picture,
                                           struct ls_diag *diag);

/** Keep a wire payload as `cam<camera>/raw/<shot>-<attempt>.raw`, byte for byte. LS_ERR_STATE
 * without keep_raw. */
LS_MUST_CHECK enum ls_err ls_store_raw(struct ls_store *store, uint32_t camera, uint32_t shot,
                                       uint32_t attempt, const void *bytes, size_t n_bytes,
                                       struct ls_diag *diag);

/** Write a sentence into the journal: drift, repair, whatever an operator should know later. */
LS_MUST_CHECK enum ls_err ls_store_alarm(struct ls_store *store, const char *text,
                                         struct ls_diag *diag);

/** Wait until everything queued before is durable. */
LS_MUST_CHECK enum ls_err ls_store_flush(struct ls_store *store, struct ls_diag *diag);

struct ls_store_stats {
    uint64_t tickets, published; /* durable in the journal, since create or reopen */
    uint64_t bytes;              /* of pictures and raw files written */
    uint32_t commits;            /* journal syncs */
    uint32_t queued;             /* items waiting */
};

/** Any thread. */
void ls_store_stats(struct ls_store *store, struct ls_store_stats *out);

/** What take.json says beside the caller's document once a take ends. */
struct ls_store_end {
    enum ls_store_state state;
    const char *take_json;      /* replaces the caller's document; NULL = as it was */
    const char *const *missing; /* "cam0/W-0137" ... */
    size_t n_missing;
    const char *skips_json; /* a JSON array, or NULL = [] */
};

/** Flush, rewrite take.json atomically, record the state in the journal, sync. */
LS_MUST_CHECK enum ls_err ls_store_set_state(struct ls_store *store, const struct ls_store_end *end,
                                             struct ls_diag *diag);

/**
 * Flush, stop ls-store, drop the reservation, unlock, free. Returns the latched error if there is
 * one. NULL is allowed. The state on disk stays as it is: set it before.
 */
enum ls_err ls_store_close(struct ls_store *store, struct ls_diag *diag);

#endif
