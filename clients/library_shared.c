/* Memory that the daemon shares: pictures, and the frames of a camera. */
#include "clients/library.h"

#include <errno.h>
#include <fcntl.h>
#include <stdatomic.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>

/* The daemon writes on, and nobody else begins to. */
enum { RING_SEALS = F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_FUTURE_WRITE };

/* proto/PROTOCOL.md, Ring: behind index_at. */
struct entry {
    _Atomic uint64_t change, number;
};
struct ring_index {
    char magic[8];
    uint32_t n_slots, unused;
    uint64_t stride, payload_bytes;
    _Atomic uint64_t landed;
    uint64_t reserved[3];
    struct entry entry[];
};

uint32_t ls_library_map(int fd, uint64_t bytes, int seals, const void **out,
                        struct lightstage_error *error)
{
    struct stat info;
    int has = fcntl(fd, F_GET_SEALS);
    if (has < 0 || (has & seals) != seals)
        return ls_library_fail(error, LIGHTSTAGE_STRANGE,
                               "the daemon's shared memory may change under its reader: its seals "
                               "are %#x, expected %#x",
                               has < 0 ? 0U : (unsigned)has, (unsigned)seals);
    if (fstat(fd, &info) || !bytes || (uint64_t)info.st_size < bytes)
        return ls_library_fail(error, LIGHTSTAGE_STRANGE,
                               "the daemon's shared memory is shorter than the %llu bytes that it "
                               "speaks of",
                               (unsigned long long)bytes);
    *out = mmap(NULL, bytes, PROT_READ, MAP_SHARED, fd, 0);
    if (*out != MAP_FAILED)
        return 0;
    *out = NULL;
    return ls_library_fail(error, LIGHTSTAGE_NO_MEMORY,
                           "the daemon's shared memory, %llu bytes, cannot be mapped: %s",
                           (unsigned long long)bytes, strerror(errno));
}

static const struct ring_index *index_of(const struct lightstage_ring *ring)
{
    return (const struct ring_index *)(const void *)((const char *)ring->memory + ring->index_at);
}

static bool fits(const struct lightstage_ring *ring)
{
    uint64_t slots = 0, end = 0;
    return ring->payload_bytes <= ring->stride &&
           !__builtin_mul_overflow(ring->stride, ring->slots, &slots) && slots <= ring->index_at &&
           ring->index_at % _Alignof(struct ring_index) == 0 &&
           !__builtin_add_overflow(ring->index_at,
                                   sizeof(struct ring_index) + ring->slots * sizeof(struct entry),
                                   &end) &&
           end <= ring->bytes;
}

static uint32_t strange_ring(struct lightstage_error *error)
{
    return ls_library_fail(error, LIGHTSTAGE_STRANGE,
                           "the daemon's ring of frames is not laid out as it says");
}

static void *make_ring(const struct ls_reply *reply, struct lightstage_error *error)
{
    const Lightstage__RingReply *r = (const Lightstage__RingReply *)reply->message;
    int fd = reply->fd;
    struct lightstage_ring *ring = ls_library_keep(reply, sizeof *ring, error);
    if (!ring)
        return NULL;
    *ring = (struct lightstage_ring){
        .take = r->take,
        .pixel_format = r->pixel_format,
        .slots = r->slots,
        .width = r->width,
        .height = r->height,
        .stride = r->stride,
        .payload_bytes = r->payload_bytes,
        .index_at = r->index_at,
        .bytes = r->bytes,
    };
    uint32_t number = !fits(ring)
                          ? strange_ring(error)
                          : ls_library_map(fd, ring->bytes, RING_SEALS, &ring->memory, error);
    if (!number && memcmp(index_of(ring)->magic, "LSRING 1", 8))
        number = strange_ring(error);
    if (!number)
        return ring;
    lightstage_ring_free(ring);
    return NULL;
}

uint32_t lightstage_ring(struct lightstage *stage, uint32_t camera, struct lightstage_ring **out,
                         struct lightstage_error *error)
{
    Lightstage__Ring body = LIGHTSTAGE__RING__INIT;
    body.camera = camera;
    return ls_library_ask(stage, LS_MESSAGE_RING, &body.base, NULL, 0, make_ring, out, error);
}

void lightstage_ring_free(struct lightstage_ring *ring)
{
    if (ring && ring->memory)
        munmap((void *)ring->memory, ring->bytes);
    ls_library_release(ring);
}

/* The slot that frame @number landed in, if it is there still. */
static const struct entry *find(const struct lightstage_ring *ring, uint64_t number)
{
    const struct ring_index *index = index_of(ring);
    for (uint32_t i = 0; i < ring->slots; i++)
        if (atomic_load_explicit(&index->entry[i].number, memory_order_acquire) == number)
            return &index->entry[i];
    return NULL;
}

uint64_t lightstage_ring_newest(const struct lightstage_ring *ring, void *frame)
{
    const struct ring_index *index = index_of(ring);
    for (uint32_t tries = 0; tries <= ring->slots; tries++) {
        uint64_t newest = atomic_load_explicit(&index->landed, memory_order_acquire);
        const struct entry *entry = newest ? find(ring, newest) : NULL;
        if (!entry)
            continue;
        uint64_t change = atomic_load_explicit(&entry->change, memory_order_acquire);
        size_t slot = (size_t)(entry - index->entry);
        if (change % 2)
            continue;
        memcpy(frame, (const char *)ring->memory + slot * ring->stride, ring->payload_bytes);
        atomic_thread_fence(memory_order_acquire);
        if (atomic_load_explicit(&entry->change, memory_order_relaxed) == change &&
            atomic_load_explicit(&entry->number, memory_order_relaxed) == newest)
            return newest;
    }
    return 0;
}
