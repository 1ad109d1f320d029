/*
 * journal: the append-only record of a take: tickets, publications, alarms, states.
 * Layer: daemon. Threads: one at a time per object. Ownership: stated per call.
 *
 * Text, one record per line: 8 lower-case hex digits (crc32c of everything between the space and
 * the newline), a space, a compact JSON object, a newline. The object's "k" is its kind:
 *   ticket     the fields of struct ls_ticket by name; "shot" first
 *   published  "condition", "camera", "file", "bytes", "width", "height", "type" half|float,
 *              "crc": 8 hex digits per 64 x 64 tile, row-major: crc32c of the tile's decoded
 * pixels, row after row, little-endian, as stored; "max": per tile the largest |value| as the 4
 * (half) or 8 (float) hex digits of its bits, NaN ignored; with invalid pixels also "invalid": a
 * count per tile and "validity": crc32c of the plane, uint8, row-major alarm      "text" state
 * "state" "t" is CLOCK_MONOTONIC_RAW ns of the writer for alarm and state. A line may be at most 4
 * MiB long.
 */
#ifndef LS_DAEMON_JOURNAL_H
#define LS_DAEMON_JOURNAL_H

#include "core/error.h"
#include "daemon/ticket.h"

#include <stddef.h>
#include <stdint.h>

/** A published picture: what a reader needs to trust a file. */
struct ls_published {
    char condition[64];
    uint32_t camera;
    char file[128]; /* relative to the take folder */
    uint64_t bytes; /* of the file */
    uint32_t width, height;
    uint32_t is_float;      /* 0 half, 1 float */
    uint32_t n_tiles;       /* ceil(width / 64) * ceil(height / 64) */
    uint32_t *tile_crc;     /* n_tiles */
    uint32_t *tile_max;     /* n_tiles, bits of the largest |value|, half or float */
    uint32_t *tile_invalid; /* n_tiles, or NULL = all valid */
    uint32_t validity_crc;
};

/** Free what it points at. */
void ls_published_finish(struct ls_published *published);

/** A growing text of records, appended to a journal in one write. Zero-initialise. */
struct ls_journal_batch {
    char *text;
    size_t n, capacity;
};

/** Errors of the adders: LS_ERR_NOMEM; LS_ERR_INVALID for a time that is not finite;
 * LS_ERR_LIMIT for a line that is too long. The batch is then as it was. */
LS_MUST_CHECK enum ls_err ls_journal_add_ticket(struct ls_journal_batch *batch,
                                                const struct ls_ticket *ticket);
LS_MUST_CHECK enum ls_err ls_journal_add_published(struct ls_journal_batch *batch,
                                                   const struct ls_published *published);
LS_MUST_CHECK enum ls_err ls_journal_add_alarm(struct ls_journal_batch *batch, uint64_t host_ns,
                                               const char *text);
LS_MUST_CHECK enum ls_err ls_journal_add_state(struct ls_journal_batch *batch, uint64_t host_ns,
                                               const char *state);

/** Append all records of @other. */
LS_MUST_CHECK enum ls_err ls_journal_add_batch(struct ls_journal_batch *batch,
                                               const struct ls_journal_batch *other);

void ls_journal_batch_finish(struct ls_journal_batch *batch);

/** Whom a replay tells; members may be NULL. Anything but LS_OK ends the replay with it. What is
 * passed is (transfer none) and valid during the call. */
struct ls_journal_reader {
    void *user;
    enum ls_err (*ticket)(void *user, const struct ls_ticket *ticket);
    enum ls_err (*published)(void *user, const struct ls_published *published);
    enum ls_err (*alarm)(void *user, const char *text);
    enum ls_err (*state)(void *user, const char *state);
};

/**
 * Replay the journal @text. *n_good: the length up to which it is whole. A last record that is
 * truncated or corrupt ends it there without an error (the caller cuts the file to *n_good before
 * appending); a bad record with a good one anywhere after it is LS_ERR_INVALID naming the line, and
 * so is a record whose checksum holds and whose contents make no sense. Unknown kinds are passed
 * over. Never asserts on what it reads.
 */
LS_MUST_CHECK enum ls_err ls_journal_replay(const char *text, size_t n,
                                            const struct ls_journal_reader *reader, size_t *n_good,
                                            struct ls_diag *diag);

#endif
