/*
 * kept: raw frames in a take's folder, where they wait for the rest of their bracket, in this run
 * or in one before it.
 * Layer: daemon. Threads: any. Ownership: as stated.
 */
#ifndef LS_DAEMON_KEPT_H
#define LS_DAEMON_KEPT_H

#include "daemon/plan.h"
#include "daemon/takedir.h"

/** A frame whose bracket is not complete. */
struct ls_kept_shot {
    bool there;
    uint32_t attempt, raw_crc32c;
    double exposure_us; /* as used */
};

/** Read shot @shot of @camera into @raw, of @n_bytes. Errors: LS_ERR_NOT_FOUND, LS_ERR_MISMATCH
 * (its length or checksum is another than its ticket's), those of ls_disk_read. */
LS_MUST_CHECK enum ls_err ls_kept_read(const char *folder, uint32_t camera, uint32_t shot,
                                       const struct ls_kept_shot *kept, void *raw, size_t n_bytes,
                                       struct ls_diag *diag);

/**
 * What an earlier run left of conditions that are not done (@done, per condition): every shot's
 * last good ticket whose frame is there, read whole and as its checksum says. Of a bracket that is
 * all there the last shot counts as missing: it is fired again, and completes it. @out: per shot,
 * zeroed. LS_ERR_MISMATCH: another plan's take.
 */
LS_MUST_CHECK enum ls_err ls_kept_find(const struct ls_takedir *take, const struct ls_plan *plan,
                                       const uint8_t *done, struct ls_kept_shot *out,
                                       struct ls_diag *diag);

#endif
