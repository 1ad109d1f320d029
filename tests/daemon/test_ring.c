/* ring and queue: who holds a slot, and what passes between threads. */
#include "daemon/queue.h"
#include "daemon/ring.h"

#include <glib.h>
#include <string.h>
#include <unistd.h>
#include <stddef.h>
#include <sys/mman.h>

static struct ls_ring *make_ring(uint32_t n, size_t bytes)
{
    struct ls_ring *ring = NULL;
    struct ls_diag diag = {0};
    g_assert_cmpint(ls_ring_create(n, bytes, &ring, &diag), ==, LS_OK);
    return ring;
}

static void test_pages(void)
{
    size_t page = (size_t)sysconf(_SC_PAGESIZE);
    struct ls_ring *ring = make_ring(16, page + 1);
    struct ls_camera_slots slots = ls_ring_slots(ring);
    g_assert_cmpuint(slots.stride, ==, 2 * page);
    g_assert_cmpuint(slots.n, ==, 16);
    memset(slots.base, 0xa5, slots.stride * slots.n);
    g_assert_true(ls_ring_payload(ring, 3) == (char *)slots.base + 3 * slots.stride);
    ls_ring_destroy(ring);
}

static void test_verbs(void)
{
    struct ls_ring *ring = make_ring(4, 100);
    g_assert_cmpuint(ls_ring_queued(ring), ==, 0);
    ls_ring_queue(ring);
    g_assert_cmpuint(ls_ring_queued(ring), ==, 4);
    g_assert_cmpint(ls_ring_take(ring, 2), ==, LS_OK);
    g_assert_cmpuint(ls_ring_queued(ring), ==, 3);
    g_assert_cmpint(ls_ring_take(ring, 2), ==, LS_ERR_BUG);
    g_assert_cmpint(ls_ring_hand(ring, 1), ==, LS_ERR_BUG);
    g_assert_cmpint(ls_ring_hand(ring, 2), ==, LS_OK);
    g_assert_cmpint(ls_ring_hand(ring, 2), ==, LS_ERR_BUG);
    g_assert_cmpuint(ls_ring_queued(ring), ==, 3);
    g_assert_cmpint(ls_ring_give_back(ring, 2), ==, LS_OK);
    g_assert_cmpint(ls_ring_give_back(ring, 2), ==, LS_ERR_BUG);
    g_assert_cmpint(ls_ring_take(ring, 4), ==, LS_ERR_BUG);
    g_assert_cmpuint(ls_ring_queued(ring), ==, 4);
    ls_ring_destroy(ring);
}

static void test_refused(void)
{
    struct ls_ring *ring = NULL;
    struct ls_diag diag = {0};
    g_assert_cmpint(ls_ring_create(0, 100, &ring, &diag), ==, LS_ERR_INVALID);
    g_assert_cmpint(ls_ring_create(16, 0, &ring, &diag), ==, LS_ERR_INVALID);
    g_assert_cmpint(ls_ring_create(1 << 20, 100, &ring, &diag), ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, "slots"));
}

enum { N_RECORDS = 200000 };

static gpointer produce(gpointer data)
{
    struct ls_queue *queue = data;
    for (uint64_t i = 0; i < N_RECORDS; i++) {
        uint64_t record[3] = {i, i * i, ~i};
        while (!ls_queue_push(queue, record))
            g_thread_yield();
    }
    return NULL;
}

static void test_queue(void)
{
    struct ls_queue queue = {0};
    g_assert_cmpint(ls_queue_init(&queue, 3 * sizeof(uint64_t), 50), ==, LS_OK);
    GThread *thread = g_thread_new("producer", produce, &queue);
    for (uint64_t i = 0; i < N_RECORDS; i++) {
        uint64_t record[3];
        while (!ls_queue_pop(&queue, record))
            g_thread_yield();
        g_assert_true(record[0] == i && record[1] == i * i && record[2] == ~i);
    }
    g_thread_join(thread);
    uint64_t none[3];
    g_assert_false(ls_queue_pop(&queue, none));
    ls_queue_finish(&queue);
}

static void test_queue_full(void)
{
    struct ls_queue queue = {0};
    int record = 1;
    g_assert_cmpint(ls_queue_init(&queue, sizeof record, 4), ==, LS_OK);
    for (int i = 0; i < 4; i++)
        g_assert_true(ls_queue_push(&queue, &record));
    g_assert_false(ls_queue_push(&queue, &record));
    g_assert_true(ls_queue_pop(&queue, &record));
    g_assert_true(ls_queue_push(&queue, &record));
    ls_queue_finish(&queue);
}

/* ---- those that only look ---- */

static const struct ls_ring_index *map_index(const struct ls_ring *ring, int *fd, void **base)
{
    g_assert_cmpint(ls_ring_share(ring, fd, NULL), ==, LS_OK);
    *base = mmap(NULL, ls_ring_bytes(ring), PROT_READ, MAP_SHARED, *fd, 0);
    g_assert_true(*base != MAP_FAILED);
    return (const struct ls_ring_index *)(void *)((char *)*base + ls_ring_index_at(ring));
}

static void test_index(void)
{
    struct ls_ring *ring = NULL;
    void *base;
    int fd;
    g_assert_cmpint(ls_ring_create(4, 5000, &ring, NULL), ==, LS_OK);
    const struct ls_ring_index *index = map_index(ring, &fd, &base);
    g_assert_cmpmem(index->magic, 8, "LSRING 1", 8);
    g_assert_cmpuint(index->n_slots, ==, 4);
    g_assert_cmpuint(index->payload_bytes, ==, 5000);
    g_assert_cmpuint(offsetof(struct ls_ring_index, entry), ==, 64);
    ls_ring_queue(ring);
    g_assert_cmpuint(index->entry[2].change % 2, ==, 1); /* one may be landing */
    memset((void *)ls_ring_payload(ring, 2), 7, 5000);
    g_assert_cmpint(ls_ring_take(ring, 2), ==, LS_OK);
    g_assert_cmpuint(index->entry[2].change % 2, ==, 0);
    g_assert_cmpuint(index->entry[2].number, ==, 1);
    g_assert_cmpuint(index->landed, ==, 1);
    g_assert_cmpint(((const char *)base)[2 * index->stride + 4999], ==, 7);
    uint64_t before = index->entry[2].change;
    g_assert_cmpint(ls_ring_hand(ring, 2), ==, LS_OK);
    g_assert_cmpuint(index->entry[2].change, ==, before); /* it is still the frame */
    g_assert_cmpint(ls_ring_give_back(ring, 2), ==, LS_OK);
    g_assert_cmpuint(index->entry[2].change, ==, before + 1);
    g_assert_cmpint(ls_ring_take(ring, 0), ==, LS_OK);
    g_assert_cmpuint(index->landed, ==, 2);
    munmap(base, ls_ring_bytes(ring));
    close(fd);
    ls_ring_destroy(ring);
}

static void test_read_only(void)
{
    struct ls_ring *ring = NULL;
    char byte = 1;
    int fd;
    g_assert_cmpint(ls_ring_create(2, 100, &ring, NULL), ==, LS_OK);
    g_assert_cmpint(ls_ring_share(ring, &fd, NULL), ==, LS_OK);
    g_assert_cmpint(pwrite(fd, &byte, 1, 0), ==, -1);
    g_assert_cmpint(ftruncate(fd, 0), ==, -1);
    g_assert_true(mmap(NULL, 100, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0) == MAP_FAILED);
    void *seen = mmap(NULL, 100, PROT_READ, MAP_SHARED, fd, 0);
    g_assert_true(seen != MAP_FAILED);
    g_assert_cmpint(mprotect(seen, 100, PROT_READ | PROT_WRITE), ==, -1);
    munmap(seen, 100);
    close(fd);
    ls_ring_destroy(ring);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/ring/slots-are-whole-pages-apart", test_pages);
    g_test_add_func("/ring/only-the-holder-passes-a-slot-on", test_verbs);
    g_test_add_func("/ring/absurd-sizes-are-refused", test_refused);
    g_test_add_func("/ring/who-looks-learns-what-has-changed", test_index);
    g_test_add_func("/ring/nobody-else-can-write", test_read_only);
    g_test_add_func("/queue/records-arrive-whole-and-in-order", test_queue);
    g_test_add_func("/queue/a-full-queue-says-so", test_queue_full);
    return g_test_run();
}
