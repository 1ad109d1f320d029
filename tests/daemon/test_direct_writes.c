/* Pictures go to the disk without a copy in the page cache where the file system lets them, and the
 * same bytes arrive where it does not. A program of its own: it stands in front of write(). */
#include "tests/daemon/store_fixture.h"

#include <errno.h>
#include <fcntl.h>
#include <unistd.h>

static struct {
    bool refuse;
    _Atomic size_t direct, cached; /* bytes */
} disk;

ssize_t __real_write(int fd, const void *bytes, size_t n);
ssize_t __wrap_write(int fd, const void *bytes, size_t n);

ssize_t __wrap_write(int fd, const void *bytes, size_t n)
{
    bool direct = fcntl(fd, F_GETFL) & O_DIRECT;
    if (direct && disk.refuse) {
        errno = EINVAL;
        return -1;
    }
    ssize_t done = __real_write(fd, bytes, n);
    if (done > 0 && direct)
        disk.direct += (size_t)done;
    else if (done > 0)
        disk.cached += (size_t)done;
    return done;
}

enum { BLOCKS = 3, N = BLOCKS * LS_DISK_BLOCK_BYTES + 77 };

struct sheet {
    char *root, *path;
    int dir_fd;
    uint8_t *bytes; /* N, from a block on, and one byte more */
};

static struct sheet begin(bool refuse)
{
    struct sheet s = {.root = new_root()};
    s.path = g_build_filename(s.root, "x", NULL);
    s.dir_fd = open(s.root, O_RDONLY | O_DIRECTORY);
    s.bytes = aligned_alloc(LS_DISK_BLOCK_BYTES, (BLOCKS + 1) * LS_DISK_BLOCK_BYTES);
    for (size_t k = 0; k <= N; k++)
        s.bytes[k] = (uint8_t)(k * 2654435761u >> 13);
    disk.refuse = refuse;
    disk.direct = disk.cached = 0;
    return s;
}

static void end(struct sheet *s)
{
    close(s->dir_fd);
    remove_tree(s->root);
    g_free(s->root);
    g_free(s->path);
    free(s->bytes);
    disk.refuse = false;
}

static size_t put(const struct sheet *s, const uint8_t *bytes, const struct ls_disk_shim *shim)
{
    struct ls_diag diag = {{0}};
    size_t n_direct = 99;
    gchar *read;
    gsize n;
    g_assert_cmpint(ls_disk_replace(shim, s->dir_fd, "x", bytes, N, &n_direct, &diag), ==, LS_OK);
    g_assert_true(g_file_get_contents(s->path, &read, &n, NULL));
    g_assert_cmpmem(read, n, bytes, N);
    g_free(read);
    return n_direct;
}

/* Some file systems of test machines refuse. */
static bool refuses(struct sheet *s)
{
    int fd = openat(s->dir_fd, "probe", O_WRONLY | O_CREAT | O_DIRECT, 0644);
    bool no = fd < 0 || __real_write(fd, s->bytes, LS_DISK_BLOCK_BYTES) < 0;
    if (fd >= 0)
        close(fd);
    if (no)
        g_test_skip("no direct writes in TMPDIR");
    return no;
}

static void whole_blocks_are_not_copied(void)
{
    struct sheet s = begin(false);
    if (!refuses(&s)) {
        g_assert_cmpuint(put(&s, s.bytes, NULL), ==, N - 77);
        g_assert_cmpuint(disk.direct, ==, N - 77);
        g_assert_cmpuint(disk.cached, ==, 77);
    }
    end(&s);
}

static void memory_from_elsewhere_is_copied(void)
{
    struct sheet s = begin(false);
    g_assert_cmpuint(put(&s, s.bytes + 1, NULL), ==, 0);
    g_assert_cmpuint(disk.cached, ==, N);
    end(&s);
}

static void a_refusal_is_no_failure(void)
{
    struct sheet s = begin(true);
    g_assert_cmpuint(put(&s, s.bytes, NULL), ==, 0);
    g_assert_cmpuint(disk.cached, ==, N);
    end(&s);
}

static int shorten(void *user, enum ls_disk_op op, const char *name, size_t *n_bytes)
{
    if (op == LS_DISK_WRITE && *n_bytes > 5000)
        *n_bytes = 5000;
    return 0;
}

static void short_writes_go_on_where_they_ended(void)
{
    const struct ls_disk_shim shim = {shorten, NULL};
    struct sheet s = begin(false);
    if (!refuses(&s))
        g_assert_cmpuint(put(&s, s.bytes, &shim), ==, N - 77);
    end(&s);
}

static void two_pictures(bool refuse)
{
    struct sheet s = begin(refuse);
    struct ls_diag diag = {{0}};
    struct ls_store_config config = a_take(s.root);
    struct ls_store *store;
    g_assert_cmpint(ls_store_create(&config, &store, &diag), ==, LS_OK);
    g_assert_cmpint(publish(store, 0, 0, &diag), ==, LS_OK);
    g_assert_cmpint(publish(store, 1, 0, &diag), ==, LS_OK);
    g_assert_cmpint(ls_store_flush(store, &diag), ==, LS_OK);
    struct ls_takedir *take = open_take(ls_store_folder(store));
    g_assert_cmpuint(take->n_published, ==, 2);
    assert_published_intact(take);
    ls_takedir_close(take);
    g_assert_cmpint(ls_store_close(store, &diag), ==, LS_OK);
    end(&s);
}

static void a_store_says_once_that_it_is_refused(void)
{
    g_test_expect_message(NULL, G_LOG_LEVEL_MESSAGE, "*refuses direct writes*");
    two_pictures(true);
    g_test_assert_expected_messages();
}

static void pictures_are_written_direct(void)
{
    struct sheet s = begin(false);
    if (!refuses(&s)) {
        two_pictures(false);
        g_assert_cmpuint(disk.direct, >, LS_DISK_BLOCK_BYTES);
    }
    end(&s);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/direct/whole-blocks-are-not-copied", whole_blocks_are_not_copied);
    g_test_add_func("/direct/memory-from-elsewhere-is-copied", memory_from_elsewhere_is_copied);
    g_test_add_func("/direct/a-refusal-is-no-failure", a_refusal_is_no_failure);
    g_test_add_func("/direct/short-writes-go-on-where-they-ended",
                    short_writes_go_on_where_they_ended);
    g_test_add_func("/direct/a-store-says-once-that-it-is-refused",
                    a_store_says_once_that_it_is_refused);
    g_test_add_func("/direct/pictures-are-written-direct", pictures_are_written_direct);
    return g_test_run();
}
