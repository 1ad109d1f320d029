/* The frame that is wanted, and no other; nobody waits. */
#include "daemon/preview.h"

#include <glib.h>
#include <string.h>

enum { WIDTH = 64, HEIGHT = 48, OFFERS = 200, THREADS = 4 };

static const struct ls_config config = {
    .n_cameras = 2,
    .cameras = {{.full_scale_dn = 255, .electrons_per_dn = 1, .read_noise_dn = 1},
                {.full_scale_dn = 255, .electrons_per_dn = 1, .read_noise_dn = 1}}};

static void offer(struct ls_preview *preview, uint32_t camera, uint64_t id)
{
    uint8_t raw[WIDTH * HEIGHT];
    memset(raw, (int)(id & 0xff), sizeof raw);
    ls_preview_offer(preview, camera, ls_pixel_by_name("Mono8"), WIDTH, HEIGHT, raw, id, 100);
}

static void test_wanted(void)
{
    struct ls_preview *preview = ls_preview_create(&config);
    offer(NULL, 0, 1);
    offer(preview, 0, 1);
    g_assert_null(ls_preview_take(preview, 0));
    ls_preview_want(preview, 0);
    g_assert_null(ls_preview_take(preview, 0));
    offer(preview, 1, 2); /* another camera's */
    offer(preview, 0, 3);
    offer(preview, 0, 4); /* too late */
    g_assert_null(ls_preview_take(preview, 1));
    const struct ls_preview_picture *picture = ls_preview_take(preview, 0);
    g_assert_nonnull(picture);
    g_assert_cmpuint(picture->frame_id, ==, 3);
    g_assert_cmpuint(picture->width, ==, WIDTH / 2);
    g_assert_cmpuint(picture->height, ==, HEIGHT / 2);
    g_assert_null(ls_preview_take(preview, 0));
    offer(preview, 0, 5); /* it is being read */
    g_assert_cmpuint(picture->frame_id, ==, 3);
    ls_preview_want(preview, 0);
    offer(preview, 0, 6);
    picture = ls_preview_take(preview, 0);
    g_assert_nonnull(picture);
    g_assert_cmpuint(picture->frame_id, ==, 6);
    ls_preview_destroy(preview);
}

static void test_unfit(void)
{
    uint8_t byte = 0;
    struct ls_preview *preview = ls_preview_create(&config);
    ls_preview_want(preview, 0);
    ls_preview_offer(preview, 0, ls_pixel_by_name("Mono8"), 1, 1, &byte, 1, 100); /* no block */
    g_assert_null(ls_preview_take(preview, 0));
    offer(preview, 0, 2);
    g_assert_nonnull(ls_preview_take(preview, 0));
    ls_preview_destroy(preview);
}

struct offerer {
    struct ls_preview *preview;
    uint64_t first;
    _Atomic bool *stop;
};

static gpointer offer_on(gpointer data)
{
    struct offerer *o = data;
    for (uint64_t id = o->first; !*o->stop; id += THREADS)
        offer(o->preview, 0, id);
    return NULL;
}

/* All of a picture is of one frame, whoever makes it. */
static void check(const struct ls_preview_picture *picture)
{
    for (uint32_t i = 1; i < picture->width * picture->height * 3; i++)
        g_assert_cmpuint(picture->rgb[i], ==, picture->rgb[0]);
    double clip = (picture->frame_id & 0xff) == 0xff;
    g_assert_cmpfloat(picture->figures.clip[0], ==, clip);
}

static void test_threads(void)
{
    struct ls_preview *preview = ls_preview_create(&config);
    _Atomic bool stop = false;
    struct offerer offerers[THREADS];
    GThread *threads[THREADS];
    for (int i = 0; i < THREADS; i++) {
        offerers[i] = (struct offerer){preview, (uint64_t)i, &stop};
        threads[i] = g_thread_new("offerer", offer_on, &offerers[i]);
    }
    for (int taken = 0; taken < OFFERS;) {
        ls_preview_want(preview, 0);
        const struct ls_preview_picture *picture = ls_preview_take(preview, 0);
        if (picture)
            check(picture);
        taken += picture != NULL;
    }
    stop = true;
    for (int i = 0; i < THREADS; i++)
        g_thread_join(threads[i]);
    ls_preview_destroy(preview);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/preview/the-next-frame-offered-is-the-one-wanted", test_wanted);
    g_test_add_func("/preview/a-frame-that-makes-no-picture-leaves-the-next-wanted", test_unfit);
    g_test_add_func("/preview/a-picture-is-of-one-frame-whoever-makes-it", test_threads);
    return g_test_run();
}
