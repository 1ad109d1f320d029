/*
 * library_pictures: what fetching in rows, in tiles and relighting share.
 * Layer: clients. Threads: the client's one. Ownership: the caller's.
 */
#ifndef LS_CLIENTS_LIBRARY_PICTURES_H
#define LS_CLIENTS_LIBRARY_PICTURES_H

#include "clients/library.h"

/** A request and what it points to, beside what the caller's struct does. Not to be copied. */
struct ls_library_fetch {
    Lightstage__Fetch body;
    Lightstage__Promotion promotion;
    Lightstage__Region region;
};

/** 107, 108. */
uint32_t ls_library_fill_fetch(struct ls_library_fetch *out, const struct lightstage_fetch *fetch,
                               struct lightstage_error *error);

/** Both with their defaults, then as the caller's; @promotion NULL is allowed. 107, 108. */
uint32_t ls_library_fill_promoted(Lightstage__Promotion *to, Lightstage__Region *to_region,
                                  const struct lightstage_promotion *promotion,
                                  const struct lightstage_region *region,
                                  struct lightstage_error *error);

/** 107, and why. */
uint32_t ls_library_credit_by_caller(struct lightstage_error *error);

/** 107: who waits for the end from within the library cannot give credit. */
uint32_t ls_library_no_credit(const struct lightstage_fetch *fetch, struct lightstage_error *error);

/** Without values. Its texts are @reply's, its report, if any, is @report. */
struct lightstage_band ls_library_band(const Lightstage__FetchReply *reply,
                                       struct lightstage_spectrum *report);

#endif
