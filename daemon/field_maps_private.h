/*
 * field_maps_private: the maps of a take, seen by their parts: field_maps.c (what there is, who
 * makes it, halves), field_maps_ratios.c (ratios, the separated model's among them),
 * field_maps_matrices.c. Layer: daemon. Threads: whoever makes maps has the turn (`making`) and
 * works without the lock. Ownership: field_maps.h.
 */
#ifndef LS_DAEMON_FIELD_MAPS_PRIVATE_H
#define LS_DAEMON_FIELD_MAPS_PRIVATE_H

#include "daemon/field_maps.h"
#include "daemon/map_file.h"

struct ls_map_entry {
    struct ls_field_map map; /* values NULL: not made */
    struct ls_map_file file, halves;
};

struct ls_field_maps {
    GMutex lock; /* of all below, but an entry's map once it is there */
    GCond made;
    bool making;
    struct ls_map_entry entry[LS_MAP_KINDS][LS_FIELD_MAX_SPECTRA];
};

/** Room for a map @depth deep. Errors: ls_map_file_create. */
LS_MUST_CHECK enum ls_err ls_map_entry_open(const struct ls_field_source *source,
                                            struct ls_map_entry *entry, uint32_t depth,
                                            struct ls_diag *diag);

/** Zeroed is allowed. */
void ls_map_entry_finish(struct ls_map_entry *entry);

/** What was made goes to its place, for all to see; or, after an error, nowhere. */
void ls_map_entry_settle(struct ls_field_source *source, enum ls_err err, struct ls_map_entry *made,
                         struct ls_map_entry *place);

/** Of every spectrum of which maps of @kind can be made and were not yet: they cost one pass
 * together. Errors: ls_field_maps_get. */
LS_MUST_CHECK enum ls_err ls_field_maps_make_ratios(struct ls_field_source *source,
                                                    enum ls_field_map_kind kind,
                                                    const struct ls_job *asker,
                                                    struct ls_diag *diag);

/** Of spectrum @s, and of every other that was photographed by the same division of the dome.
 * Errors: ls_field_maps_get. */
LS_MUST_CHECK enum ls_err ls_field_maps_make_matrices(struct ls_field_source *source, uint32_t s,
                                                      const struct ls_job *asker,
                                                      struct ls_diag *diag);

#endif
