#include "daemon/ring.h"

#include <errno.h>
#include <fcntl.h>

#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

enum { MAX_SLOTS = 1024 };

enum slot_state { SLOT_IDLE, SLOT_QUEUED, SLOT_TAKEN, SLOT_HANDED };

struct ls_ring {
    int fd;
    unsigned char *base;
    size_t stride, bytes;
    struct ls_ring_index *index; /* in the memfd, behind the slots */
    uint32_t n;
    _Atomic uint32_t queued;
    _Atomic unsigned char *state; /* enum slot_state per slot */
};

static enum ls_err map(struct ls_ring *ring, struct ls_diag *diag)
{
    ring->fd = memfd_create("lightstaged-ring", MFD_CLOEXEC | MFD_ALLOW_SEALING);
    if (ring->fd < 0)
        return ls_fail(diag, LS_ERR_OS, "ring: memfd_create: %s", strerror(errno));
    int err = posix_fallocate(ring->fd, 0, (off_t)ring->bytes);
    if (err)
        return ls_fail(diag, err == ENOSPC || err == ENOMEM ? LS_ERR_NOMEM : LS_ERR_OS,
                       "ring: %zu bytes for %u slots: %s; use fewer ring_slots or a smaller region",
                       ring->bytes, ring->n, strerror(err));
    void *base =
        mmap(NULL, ring->bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, ring->fd, 0);
    if (base == MAP_FAILED)
        return ls_fail(diag, LS_ERR_OS, "ring: mmap of %zu bytes: %s", ring->bytes,
                       strerror(errno));
    ring->base = base;
    (void)mlock(base, ring->bytes); /* without the privilege it stays pageable */
    if (fcntl(ring->fd, F_ADD_SEALS,
              F_SEAL_FUTURE_WRITE | F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL))
        return ls_fail(diag, LS_ERR_OS, "ring: cannot be sealed: %s", strerror(errno));
    return LS_OK;
}

static void write_index(struct ls_ring *ring, size_t payload_bytes)
{
    ring->index = (struct ls_ring_index *)(void *)(ring->base + ls_ring_index_at(ring));
    memcpy(ring->index->magic, "LSRING 1", sizeof ring->index->magic);
    ring->index->n_slots = ring->n;
    ring->index->stride = ring->stride;
    ring->index->payload_bytes = payload_bytes;
    for (uint32_t i = 0; i < ring->n; i++)
        atomic_store(&ring->index->entry[i].change, 1);
}

enum ls_err ls_ring_create(uint32_t n_slots, size_t payload_bytes, struct ls_ring **out,
                           struct ls_diag *diag)
{
    size_t page = (size_t)sysconf(_SC_PAGESIZE);
    if (n_slots == 0 || n_slots > MAX_SLOTS || payload_bytes == 0 ||
        payload_bytes > SIZE_MAX / MAX_SLOTS / 2)
        return ls_fail(diag, LS_ERR_INVALID,
                       "ring: %u slots of %zu bytes: expected 1 to %d slots, not empty", n_slots,
                       payload_bytes, MAX_SLOTS);
    struct ls_ring *ring = calloc(1, sizeof *ring);
    if (!ring)
        return LS_ERR_NOMEM;
    ring->fd = -1;
    ring->n = n_slots;
    ring->stride = (payload_bytes + page - 1) / page * page;
    size_t index = sizeof *ring->index + n_slots * sizeof *ring->index->entry;
    ring->bytes = ring->stride * n_slots + (index + page - 1) / page * page;
    ring->state = calloc(n_slots, sizeof *ring->state);
    enum ls_err err = ring->state ? map(ring, diag) : LS_ERR_NOMEM;
    if (err) {
        ls_ring_destroy(ring);
        return err;
    }
    write_index(ring, payload_bytes);
    *out = ring;
    return LS_OK;
}

struct ls_camera_slots ls_ring_slots(const struct ls_ring *ring)
{
    return (struct ls_camera_slots){.base = ring->base, .stride = ring->stride, .n = ring->n};
}

const void *ls_ring_payload(const struct ls_ring *ring, uint32_t slot)
{
    return ring->base + ring->stride * slot;
}

uint64_t ls_ring_index_at(const struct ls_ring *ring)
{
    return ring->stride * ring->n;
}

uint64_t ls_ring_payload_bytes(const struct ls_ring *ring)
{
    return ring->index->payload_bytes;
}

uint64_t ls_ring_bytes(const struct ls_ring *ring)
{
    return ring->bytes;
}

enum ls_err ls_ring_share(const struct ls_ring *ring, int *fd, struct ls_diag *diag)
{
    *fd = fcntl(ring->fd, F_DUPFD_CLOEXEC, 0);
    return *fd < 0 ? ls_fail(diag, LS_ERR_OS, "ring: dup: %s", strerror(errno)) : LS_OK;
}

/* A frame is there: even; the driver may write: odd. */
static void say_changed(struct ls_ring *ring, uint32_t slot, bool there)
{
    struct ls_ring_entry *entry = &ring->index->entry[slot];
    if ((atomic_load(&entry->change) % 2 == 0) == there)
        return;
    if (there) {
        uint64_t number = atomic_load(&ring->index->landed) + 1;
        atomic_store(&entry->number, number);
        atomic_fetch_add(&entry->change, 1);
        atomic_store(&ring->index->landed, number);
    } else {
        atomic_fetch_add(&entry->change, 1);
    }
}

void ls_ring_queue(struct ls_ring *ring)
{
    for (uint32_t i = 0; i < ring->n; i++) {
        atomic_store(&ring->state[i], SLOT_QUEUED);
        say_changed(ring, i, false);
    }
    atomic_store(&ring->queued, ring->n);
}

static bool pass(struct ls_ring *ring, uint32_t slot, enum slot_state from, enum slot_state to)
{
    unsigned char expected = (unsigned char)from;
    return slot < ring->n &&
           atomic_compare_exchange_strong(&ring->state[slot], &expected, (unsigned char)to);
}

enum ls_err ls_ring_take(struct ls_ring *ring, uint32_t slot)
{
    if (!pass(ring, slot, SLOT_QUEUED, SLOT_TAKEN))
        return LS_ERR_BUG;
    atomic_fetch_sub(&ring->queued, 1);
    say_changed(ring, slot, true);
    return LS_OK;
}

enum ls_err ls_ring_hand(struct ls_ring *ring, uint32_t slot)
{
    return pass(ring, slot, SLOT_TAKEN, SLOT_HANDED) ? LS_OK : LS_ERR_BUG;
}

enum ls_err ls_ring_give_back(struct ls_ring *ring, uint32_t slot)
{
    if (!pass(ring, slot, SLOT_TAKEN, SLOT_QUEUED) && !pass(ring, slot, SLOT_HANDED, SLOT_QUEUED))
        return LS_ERR_BUG;
    say_changed(ring, slot, false); /* the driver has it once it is released, after this */
    atomic_fetch_add(&ring->queued, 1);
    return LS_OK;
}

uint32_t ls_ring_queued(const struct ls_ring *ring)
{
    return atomic_load(&ring->queued);
}

void ls_ring_destroy(struct ls_ring *ring)
{
    if (!ring)
        return;
    if (ring->base)
        munmap(ring->base, ring->bytes);
    if (ring->fd >= 0)
        close(ring->fd);
    free((void *)ring->state);
    free(ring);
}
