/*
 * store_fixture: verbs for tests of takes on disk: a root, a take, pictures that can be told apart.
 * Layer: tests. Threads: as the store's. Ownership: strings are (transfer full), g_free.
 */
#ifndef LS_TESTS_DAEMON_STORE_FIXTURE_H
#define LS_TESTS_DAEMON_STORE_FIXTURE_H

#include "core/crc32c.h"
#include "daemon/store.h"
#include "daemon/takedir.h"

#include <glib.h>
#include <glib/gstdio.h>
#include <stdlib.h>
#include <string.h>

enum { PICTURE_W = 100, PICTURE_H = 70, N_CONDITIONS = 12 };

static const char *const condition_ids[N_CONDITIONS] = {
    "dark-0", "W-0000", "W-0001", "W-0002",   "W-0003",   "W-0004",
    "W-0005", "W-0006", "W-0007", "sphere-W", "sphere-R", "sphere-B"};

static inline char *new_root(void)
{
    GError *error = NULL;
    char *root = g_dir_make_tmp("ls-store-XXXXXX", &error);
    g_assert_no_error(error);
    return root;
}

static inline void remove_tree(const char *path)
{
    GDir *dir = g_file_test(path, G_FILE_TEST_IS_DIR) ? g_dir_open(path, 0, NULL) : NULL;
    for (const char *name; dir && (name = g_dir_read_name(dir));) {
        char *child = g_build_filename(path, name, NULL);
        remove_tree(child);
        g_free(child);
    }
    if (dir)
        g_dir_close(dir);
    g_remove(path);
}

static inline unsigned count_files(const char *path)
{
    unsigned n = 0;
    GDir *dir = g_dir_open(path, 0, NULL);
    while (dir && g_dir_read_name(dir))
        n++;
    if (dir)
        g_dir_close(dir);
    return n;
}

static inline struct ls_store_config a_take(const char *root)
{
    return (struct ls_store_config){.root = root,
                                    .name = "still_life-1",
                                    .take_json = "{\"plan\": {\"x\": 1}}",
                                    .utc_s = 1715947200,
                                    .n_cameras = 1,
                                    .n_shots = N_CONDITIONS,
                                    .conditions = condition_ids,
                                    .n_conditions = N_CONDITIONS,
                                    .need_bytes = 1 << 20};
}

/* Pixels depend on condition and camera; every third picture has invalid pixels; darks are float.
 */
static inline enum ls_err publish(struct ls_store *store, uint32_t condition, uint32_t camera,
                                  struct ls_diag *diag)
{
    uint16_t half[PICTURE_W * PICTURE_H];
    float dn[PICTURE_W * PICTURE_H];
    uint8_t validity[PICTURE_W * PICTURE_H] = {0};
    struct ls_exr_attrs attrs = {0};
    for (int k = 0; k < PICTURE_W * PICTURE_H; k++) {
        half[k] = (uint16_t)((k * 31 + condition * 977 + camera * 131) & 0xbbff);
        dn[k] = (float)(k % 64) + (float)camera;
    }
    validity[condition] = condition % 3 == 0;
    ls_exr_attrs_int(&attrs, "lightstage/light", (int)condition);
    struct ls_store_picture picture = {condition_ids[condition],
                                       camera,
                                       {PICTURE_W, PICTURE_H, condition ? half : NULL,
                                        condition ? NULL : dn, condition ? validity : NULL,
                                        &attrs}};
    enum ls_err err = ls_store_publish(store, &picture, diag);
    ls_exr_attrs_finish(&attrs);
    return err;
}

/* A shot of a take of @cameras. */
static inline enum ls_err ticket_of(struct ls_store *store, uint32_t cameras, uint32_t shot,
                                    struct ls_diag *diag)
{
    struct ls_ticket t = {.shot = shot,
                          .step = shot / cameras,
                          .camera = shot % cameras,
                          .condition = shot / cameras,
                          .pulse_us = 1000,
                          .frame_id = shot + 1,
                          .status = LS_FRAME_OK,
                          .exposure_used_us = 1013.7,
                          .residual_us = 0.25,
                          .raw_bytes = 3,
                          .raw_crc32c = ls_crc32c(0, "raw", 3)};
    return ls_store_ticket(store, &t, diag);
}

static inline enum ls_err ticket(struct ls_store *store, uint32_t shot, struct ls_diag *diag)
{
    return ticket_of(store, 1, shot, diag);
}

static inline struct ls_takedir *open_take(const char *folder)
{
    struct ls_takedir *take;
    struct ls_diag diag = {0};
    enum ls_err err = ls_takedir_open(folder, &take, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    return take;
}

/* Every published picture verifies, bit for bit. */
static inline void assert_published_intact(const struct ls_takedir *take)
{
    for (size_t k = 0; k < take->n_published; k++) {
        uint8_t *bytes;
        size_t n;
        struct ls_diag diag = {0};
        enum ls_err err = ls_takedir_read(take, &take->published[k], &bytes, &n, &diag);
        if (!err)
            err = ls_published_check(&take->published[k], bytes, n, &diag);
        g_assert_cmpstr(diag.text, ==, "");
        g_assert_cmpint(err, ==, LS_OK);
        g_assert_cmpuint(n, ==, take->published[k].bytes);
        free(bytes);
    }
}

/* Publish what is not there yet, end complete, and find everything well. */
static inline void finish_take(const char *folder)
{
    struct ls_store *store;
    struct ls_diag diag = {0};
    enum ls_err err = ls_store_reopen(folder, 1 << 20, 0, NULL, &store, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    struct ls_takedir *before = open_take(folder);
    for (uint32_t k = 0; k < N_CONDITIONS; k++) {
        bool there = ls_takedir_find(before, condition_ids[k], 0) != NULL;
        if (!ls_takedir_ticket(before, k))
            g_assert_cmpint(ticket(store, k, NULL), ==, LS_OK);
        g_assert_cmpint(publish(store, k, 0, NULL), ==, there ? LS_ERR_EXISTS : LS_OK);
    }
    ls_takedir_close(before);
    struct ls_store_end end = {.state = LS_STORE_COMPLETE};
    g_assert_cmpint(ls_store_set_state(store, &end, NULL), ==, LS_OK);
    g_assert_cmpint(ls_store_close(store, NULL), ==, LS_OK);
    struct ls_takedir *take = open_take(folder);
    struct ls_take_report report;
    g_assert_cmpint(ls_takedir_verify(take, &report, NULL), ==, LS_OK);
    g_assert_cmpstr(report.text, ==, "");
    g_assert_cmpuint(report.pictures_good, ==, N_CONDITIONS);
    g_assert_cmpuint(report.shots_ticketed, ==, N_CONDITIONS);
    g_assert_cmpint(take->state, ==, LS_STORE_COMPLETE);
    ls_take_report_finish(&report);
    ls_takedir_close(take);
}

#endif
