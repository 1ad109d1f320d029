/*
 * takedir: takes on disk, read: list, open, look up, verify.
 * Layer: daemon. Threads: one at a time per object; independent of a store writing the same take
 * (a reader sees a prefix of its journal). Ownership: an ls_takedir owns everything it hands out.
 */
#ifndef LS_DAEMON_TAKEDIR_H
#define LS_DAEMON_TAKEDIR_H

#include "core/error.h"
#include "daemon/journal.h"
#include "daemon/store.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/** One line of a list of takes. */
struct ls_take_summary {
    char id[128]; /* folder name */
    char name[65];
    enum ls_store_state state;
    uint32_t shots_planned, conditions_planned; /* conditions: times cameras */
    char damage[160];                           /* why take.json could not be read, or "" */
};

/** Does @id look like a take's folder name, without any path in it? RT-safe. */
bool ls_takedir_id_ok(const char *id);

/** Take name or condition id: [A-Za-z0-9_-]{1,@max_length}. RT-safe. */
bool ls_takedir_name_ok(const char *name, size_t max_length);

/** The takes under @root, oldest first; folders of other names are passed over. *takes: (transfer
 * full), free(). Errors: LS_ERR_NOT_FOUND (root), LS_ERR_OS, LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_takedir_list(const char *root, struct ls_take_summary **takes,
                                          size_t *n, struct ls_diag *diag);

/** A take as its files say. */
struct ls_takedir {
    char *folder;
    char id[128];
    char name[65];
    char *take_json; /* text of take.json */
    enum ls_store_state state;
    uint32_t n_cameras, n_shots;
    uint32_t n_conditions;
    char **conditions; /* planned ids */
    bool keep_raw;
    struct ls_ticket *tickets; /* in journal order, every attempt */
    size_t n_tickets;
    struct ls_published *published; /* in journal order */
    size_t n_published;
    char **alarms;
    size_t n_alarms;
    size_t torn_bytes; /* of the journal's tail, not yet cut off */
    size_t journal_good_bytes;
};

/** Open by folder path: read take.json, replay the journal; changes nothing. Errors:
 * LS_ERR_NOT_FOUND, LS_ERR_INVALID (damaged, with the line), LS_ERR_UNSUPPORTED (other format).
 * *out: (transfer full). */
LS_MUST_CHECK enum ls_err ls_takedir_open(const char *folder, struct ls_takedir **out,
                                          struct ls_diag *diag);

/** NULL if @condition of @camera is not published. (transfer none). */
const struct ls_published *ls_takedir_find(const struct ls_takedir *take, const char *condition,
                                           uint32_t camera);

/** The last good ticket of a shot, or NULL. (transfer none). */
const struct ls_ticket *ls_takedir_ticket(const struct ls_takedir *take, uint32_t shot);

/** Read a published file whole; check nothing. *bytes: (transfer full), free(). For mapping
 * instead, join ls_takedir.folder and ls_published.file. */
LS_MUST_CHECK enum ls_err ls_takedir_read(const struct ls_takedir *take,
                                          const struct ls_published *published, uint8_t **bytes,
                                          size_t *n_bytes, struct ls_diag *diag);

/** Do the decoded tiles of this file's @bytes have the checksums, maxima and invalid counts of the
 * journal? LS_ERR_MISMATCH or LS_ERR_INVALID with a sentence naming file and tile. Layout and
 * compression may have changed since. */
LS_MUST_CHECK enum ls_err ls_published_check(const struct ls_published *published,
                                             const void *bytes, size_t n_bytes,
                                             struct ls_diag *diag);

/** What verify found. */
struct ls_take_report {
    uint32_t shots_planned, shots_ticketed;   /* shots with at least one good ticket */
    uint32_t pictures_planned, pictures_good; /* conditions times cameras */
    uint32_t pictures_missing, pictures_damaged;
    char *text; /* one sentence per line for everything missing or damaged; "" = all is well */
};

/** Re-read every published file, count tickets against the plan and follow each (take_links.h). Returns LS_OK if it could look,
 * whatever it found, raw frames of the last good tickets included; LS_ERR_NOMEM, LS_ERR_OS
 * otherwise. @report: finish it. */
LS_MUST_CHECK enum ls_err ls_takedir_verify(const struct ls_takedir *take,
                                            struct ls_take_report *report, struct ls_diag *diag);

void ls_take_report_finish(struct ls_take_report *report);

/** NULL is allowed. */
void ls_takedir_close(struct ls_takedir *take);

#endif
