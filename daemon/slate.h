/*
 * slate: what people write down about a take. It lives beside the take's data in slate.json, may
 * be changed while the take runs and at any time after, and nothing else reads it.
 * Layer: daemon. Threads: any; writers of one folder wait for each other. Ownership: the caller's.
 */
#ifndef LS_DAEMON_SLATE_H
#define LS_DAEMON_SLATE_H

#include "core/error.h"

#include <stdbool.h>
#include <stdint.h>

enum { LS_SLATE_MAX_TAKE = 99999 };

/** All zero: nothing written down. Texts are UTF-8. */
struct ls_slate {
    char slate[64], scene[64];
    uint32_t take; /* [1, LS_SLATE_MAX_TAKE], 0: none */
    bool circled;
    char timecode[12]; /* HH:MM:SS:FF, with ';' before FF for drop frame; SMPTE ST 12-1 */
    char notes[4096];
};

/** Could this be written down? LS_ERR_INVALID: take or timecode out of range, text that is not
 * UTF-8 or has control characters (notes may have line breaks). */
LS_MUST_CHECK enum ls_err ls_slate_check(const struct ls_slate *slate, struct ls_diag *diag);

/** The slate of the take in @folder; all zero where there is none. Errors: LS_ERR_NOT_FOUND (no
 * such folder), LS_ERR_INVALID (damaged, or over 64 KiB; the sentence says what to do), LS_ERR_OS,
 * LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_slate_read(const char *folder, struct ls_slate *slate,
                                        struct ls_diag *diag);

/** Fields of a slate, or-ed: bit n - 1 is number n of Slate in proto/lightstage.proto. */
enum {
    LS_SLATE_FIELDS = 6,
    LS_SLATE_SLATE = 1,
    LS_SLATE_SCENE = 2,
    LS_SLATE_TAKE = 4,
    LS_SLATE_CIRCLED = 8,
    LS_SLATE_TIMECODE = 16,
    LS_SLATE_NOTES = 32,
    LS_SLATE_ALL = 63,
};

/**
 * Change @fields of it to what @slate says, atomically and durably; whoever changes other fields at
 * the same time loses nothing. @slate: then as it now is, the whole of it; after an error as it
 * was. A damaged slate becomes slate.damaged.json, in place of an older one, and *damaged says so;
 * what @fields leave out is then empty. Errors: as check and read but for damage, and LS_ERR_FULL.
 */
LS_MUST_CHECK enum ls_err ls_slate_change(const char *folder, unsigned fields,
                                          struct ls_slate *slate, bool *damaged,
                                          struct ls_diag *diag);

#endif
