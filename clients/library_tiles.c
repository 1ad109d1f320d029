/* Fetch in whole tiles. */
#include "clients/library_pictures.h"

#include <fcntl.h>
#include <sys/mman.h>

enum { TILE_SEALS = F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE };
enum { SIDE = 64, SHARED_AT_ONCE = 256 << 20 /* bytes of memory; as the daemon keeps */ };

struct tiles_call {
    lightstage_on_tile *callback;
    void *user;
    struct lightstage *stage;
    bool gives_back; /* credit, for what the callback has seen */
};

/* Else the caller has it, or it is left out. */
static bool is_sent(const Lightstage__FetchReply *r, size_t i)
{
    return r->tile_hash[i] && !(r->n_tile_unchanged && r->tile_unchanged[i]);
}

static bool fits(const Lightstage__FetchReply *r, size_t tile_bytes, size_t payload_bytes)
{
    size_t sent = 0;
    if (r->width > 65536 || r->height > 65536 || r->components > 16 ||
        r->n_tile_hash != r->n_tile || (r->n_tile_unchanged && r->n_tile_unchanged != r->n_tile))
        return false;
    size_t across = (r->width + SIDE - 1) / SIDE, down = (r->height + SIDE - 1) / SIDE;
    for (size_t i = 0; i < r->n_tile; i++) {
        if (r->tile[i] >= across * down)
            return false;
        sent += is_sent(r, i);
    }
    if (r->memfd)
        return payload_bytes == 0 && r->memfd_bytes >= across * down * tile_bytes;
    return payload_bytes == sent * tile_bytes;
}

/* Of a frame. @from: its payload, or with memfd the memory of all tiles. *seen: bytes of values. */
static int hand_tiles(const struct tiles_call *call, const Lightstage__FetchReply *r,
                      const uint8_t *from, size_t bytes, uint64_t *seen)
{
    struct lightstage_spectrum report;
    const struct lightstage_band picture = ls_library_band(r, &report);
    int stop = 0;
    for (size_t i = 0; i < r->n_tile && !stop; i++) {
        bool sent = is_sent(r, i);
        size_t at = r->memfd ? r->tile[i] * bytes : (size_t)*seen;
        const struct lightstage_tile tile = {
            .picture = &picture,
            .values = sent ? from + at : NULL,
            .values_bytes = sent ? bytes : 0,
            .index = r->first_tile + (uint32_t)i,
            .number = r->tile[i],
            .hash = r->tile_hash[i],
        };
        *seen += tile.values_bytes;
        stop = call->callback(&tile, call->user);
    }
    return stop;
}

static uint32_t take_tiles(const struct ls_reply *reply, void *user, struct lightstage_error *error)
{
    const Lightstage__FetchReply *r = (const Lightstage__FetchReply *)reply->message;
    const struct tiles_call *call = user;
    size_t bytes =
        (size_t)SIDE * SIDE * r->components * (r->sample == LIGHTSTAGE__SAMPLE__HALF ? 2 : 4);
    uint64_t seen = 0;
    if (!fits(r, bytes, reply->payload_bytes))
        return ls_library_fail(error, LIGHTSTAGE_STRANGE,
                               "the daemon sent tiles that do not fit the picture");
    const void *mapped = NULL;
    uint32_t number =
        r->memfd ? ls_library_map(reply->fd, r->memfd_bytes, TILE_SEALS, &mapped, error) : 0;
    if (number)
        return number;
    int stop = hand_tiles(call, r, mapped ? mapped : reply->payload, bytes, &seen);
    if (mapped)
        munmap((void *)mapped, r->memfd_bytes);
    if (stop)
        return ls_library_stopped(stop, error);
    return call->gives_back && seen && !reply->last
               ? lightstage_credit(call->stage, reply->request, seen, error)
               : 0;
}

uint32_t lightstage_fetch_tiles_begin(struct lightstage *stage,
                                      const struct lightstage_fetch *fetch,
                                      const struct lightstage_have *have,
                                      lightstage_on_tile *callback, void *user, uint32_t *request,
                                      struct lightstage_error *error)
{
    struct tiles_call call = {callback, user, stage, false};
    struct ls_library_fetch own;
    struct lightstage_have h = {0};
    uint32_t number = have ? ls_library_take_in(&h, sizeof h, have, error) : 0;
    if (!number)
        number = ls_library_fill_fetch(&own, fetch, error);
    if (number)
        return number;
    call.gives_back = own.body.memfd && !own.body.credit_bytes;
    if (call.gives_back)
        own.body.credit_bytes = SHARED_AT_ONCE;
    own.body.tiles = true;
    own.body.first_tile = h.first_tile;
    return ls_library_begin(stage, LS_MESSAGE_FETCH, &own.body.base, h.hashes,
                            h.n_hashes * sizeof *h.hashes, take_tiles, &call, sizeof call, request,
                            error);
}

uint32_t lightstage_fetch_tiles(struct lightstage *stage, const struct lightstage_fetch *fetch,
                                const struct lightstage_have *have, lightstage_on_tile *callback,
                                void *user, struct lightstage_error *error)
{
    uint32_t request = 0;
    uint32_t number = ls_library_no_credit(fetch, error);
    if (!number)
        number = lightstage_fetch_tiles_begin(stage, fetch, have, callback, user, &request, error);
    return number ? number : lightstage_wait(stage, request, error);
}
