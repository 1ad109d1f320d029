/*
 * field_cache: the field sources in use, and the last few that were.
 * Layer: daemon. Threads: any. Ownership: sources are shared; every get is matched by a put.
 */
#ifndef LS_DAEMON_FIELD_CACHE_H
#define LS_DAEMON_FIELD_CACHE_H

#include "core/error.h"
#include "daemon/field_source.h"

#include <stdint.h>

struct ls_field_cache;

/** Keep up to @n_idle sources that nobody uses; their maps take room in the storage folder
 * (daemon/field_maps.h), whose disk keeps @spare_bytes free. @storage: (transfer none). (transfer
 * full). */
struct ls_field_cache *ls_field_cache_create(const char *storage, unsigned n_idle,
                                             uint64_t spare_bytes);

/** Opened now or before; opened anew if since then the take's journal has grown or a picture has
 * changed its length. Errors: those of
 * ls_field_source_open. */
LS_MUST_CHECK enum ls_err ls_field_cache_get(struct ls_field_cache *cache, const char *take,
                                             uint32_t camera, struct ls_field_source **out,
                                             struct ls_diag *diag);

/** Somebody else uses a source that is in use: one put more. */
void ls_field_cache_share(struct ls_field_cache *cache, struct ls_field_source *source);

void ls_field_cache_put(struct ls_field_cache *cache, struct ls_field_source *source);

/** Nobody uses a source any more. NULL is allowed. */
void ls_field_cache_destroy(struct ls_field_cache *cache);

#endif
