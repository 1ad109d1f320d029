#include "daemon/picture_map.h"

#include "core/demosaic.h"
#include "core/half.h"
#include "core/merge.h"

#include <errno.h>
#include <fcntl.h>
#include <glib.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

static struct ls_picture_id id_of(const struct stat *info)
{
    return (struct ls_picture_id){.device = info->st_dev,
                                  .inode = info->st_ino,
                                  .bytes = (uint64_t)info->st_size,
                                  .changed_ns = (int64_t)info->st_ctim.tv_sec * 1000000000 +
                                                info->st_ctim.tv_nsec};
}

static enum ls_err map_file(struct ls_picture_map *map, const char *path, struct ls_diag *diag)
{
    struct stat info;
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
    if (fd < 0) {
        bool ours = errno == EMFILE || errno == ENFILE || errno == ENOMEM;
        return ls_fail(diag, ours ? LS_ERR_OS : LS_ERR_INVALID, "%s: %s", path, strerror(errno));
    }
    enum ls_err err = LS_OK;
    if (fstat(fd, &info) || !S_ISREG(info.st_mode) || info.st_size <= 0) {
        err = ls_fail(diag, LS_ERR_INVALID, "%s: expected a file that is not empty", path);
    } else {
        map->bytes = (size_t)info.st_size;
        map->id = id_of(&info);
        map->base = mmap(NULL, map->bytes, PROT_READ, MAP_SHARED, fd, 0);
        if (map->base == MAP_FAILED) {
            map->base = NULL;
            err = ls_fail(diag, LS_ERR_OS, "%s: cannot be mapped: %s", path, strerror(errno));
        } else {
            ls_map_guard_add(&map->guard, map->base, map->bytes);
        }
    }
    close(fd);
    return err;
}

static enum ls_err check(const struct ls_exr_tiles *t, const char *path, uint32_t width,
                         uint32_t height, struct ls_diag *diag)
{
    if (t->width != width || t->height != height)
        return ls_fail(diag, LS_ERR_INVALID, "%s: %u x %u pixels, expected %u x %u", path, t->width,
                       t->height, width, height);
    if (t->type != LS_EXR_HALF || t->tile_w != LS_EXR_TILE_PX || t->tile_h != LS_EXR_TILE_PX)
        return ls_fail(diag, LS_ERR_INVALID, "%s: expected half floats in tiles of 64 x 64", path);
    return LS_OK;
}

enum ls_err ls_picture_map_open(struct ls_picture_map *map, const char *folder, const char *file,
                                uint32_t width, uint32_t height, struct ls_diag *diag)
{
    char path[4096];
    struct ls_diag inner = {0};
    memset(map, 0, sizeof *map);
    if (snprintf(path, sizeof path, "%s/%s", folder, file) >= (int)sizeof path)
        return ls_fail(diag, LS_ERR_INVALID, "%s: the path is too long", folder);
    enum ls_err err = map_file(map, path, diag);
    if (err)
        return err;
    map->path = g_strdup(path);
    err = ls_exr_map_tiles(map->base, map->bytes, NULL, &map->tiles, &inner);
    if (err)
        ls_fail(diag, err, "%.300s: %.200s", path, inner.text);
    else
        err = check(&map->tiles, path, width, height, diag);
    if (!ls_picture_map_sound(map))
        err = ls_fail(diag, LS_ERR_INVALID, "%s: cannot be read to its end", path);
    if (err)
        ls_picture_map_finish(map);
    return err;
}

bool ls_picture_map_sound(const struct ls_picture_map *map)
{
    return !ls_map_guard_lost(&map->guard);
}

bool ls_picture_map_whole(const struct ls_picture_map *map)
{
    struct stat info;
    return lstat(map->path, &info) == 0 && S_ISREG(info.st_mode) &&
           (size_t)info.st_size == map->bytes;
}

/* A run of pixels inside one tile row. */
struct run {
    const uint8_t *halfs; /* any alignment */
    uint32_t n;
};

static struct run run_at(const struct ls_exr_tiles *t, uint32_t x, uint32_t y, uint32_t end)
{
    uint32_t tx = x / t->tile_w, ty = y / t->tile_h;
    uint32_t across = ls_exr_tile_width(t, tx), in_x = x % t->tile_w, in_y = y % t->tile_h;
    uint32_t left = across - in_x;
    const uint8_t *tile = t->tile[(size_t)ty * t->n_x + tx];
    return (struct run){.halfs = tile + 2 * ((size_t)in_y * across + in_x),
                        .n = left < end - x ? left : end - x};
}

/* @rows rows of @bytes bytes. */
static inline void copy_rows(const uint8_t *from, size_t from_step, size_t bytes, uint32_t rows,
                             uint8_t *to, size_t to_step)
{
    for (uint32_t y = 0; y < rows; y++, from += from_step, to += to_step)
        memcpy(to, from, bytes);
}

/* The lengths of a tile with the pixels around it are the compiler's to know. */
static void copy_run(struct run run, size_t from_step, uint32_t rows, uint16_t *out, size_t width)
{
    uint8_t *to = (uint8_t *)out;
    if (run.n == LS_EXR_TILE_PX)
        copy_rows(run.halfs, from_step, 2 * LS_EXR_TILE_PX, rows, to, 2 * width);
    else if (run.n == LS_DEMOSAIC_HALO)
        copy_rows(run.halfs, from_step, 2 * LS_DEMOSAIC_HALO, rows, to, 2 * width);
    else
        copy_rows(run.halfs, from_step, 2 * (size_t)run.n, rows, to, 2 * width);
}

/* Tile by tile: what is cut out of one lies in one piece of memory. */
static void read_halfs(const struct ls_exr_tiles *tiles, uint32_t x, uint32_t y, uint32_t width,
                       uint32_t height, uint16_t *out)
{
    uint32_t rows;
    for (uint32_t row = y; row < y + height; row += rows) {
        uint32_t left = tiles->tile_h - row % tiles->tile_h, end = y + height;
        rows = left < end - row ? left : end - row;
        for (uint32_t col = x; col < x + width;) {
            struct run run = run_at(tiles, col, row, x + width);
            size_t step = 2 * (size_t)ls_exr_tile_width(tiles, col / tiles->tile_w);
            copy_run(run, step, rows, out + (col - x), width);
            col += run.n;
        }
        out += (size_t)rows * width;
    }
}

void ls_picture_map_read_half(const struct ls_picture_map *map, uint32_t x, uint32_t y,
                              uint32_t width, uint32_t height, uint16_t *out)
{
    read_halfs(&map->tiles, x, y, width, height, out);
}

bool ls_picture_map_tile_is_whole(const struct ls_picture_map *map, uint32_t number)
{
    const struct ls_exr_tiles *t = &map->tiles;
    return ls_exr_tile_width(t, number % t->n_x) == LS_EXR_TILE_PX &&
           ls_exr_tile_height(t, number / t->n_x) == LS_EXR_TILE_PX;
}

const uint8_t *ls_picture_map_tile(const struct ls_picture_map *map, uint32_t number, uint8_t *room)
{
    const struct ls_exr_tiles *t = &map->tiles;
    uint32_t w = ls_exr_tile_width(t, number % t->n_x), h = ls_exr_tile_height(t, number / t->n_x);
    if (ls_picture_map_tile_is_whole(map, number))
        return t->tile[number];
    memset(room, 0, (size_t)2 * LS_EXR_TILE_PX * LS_EXR_TILE_PX);
    for (uint32_t y = 0; y < h; y++)
        memcpy(room + (size_t)2 * LS_EXR_TILE_PX * y, t->tile[number] + (size_t)2 * w * y,
               (size_t)2 * w);
    return room;
}

/* The number a half says, or -1. */
static int validity_of(uint16_t half)
{
    static const uint16_t halfs[] = {[LS_VALIDITY_OK] = 0,
                                     [LS_VALIDITY_SATURATED] = 0x3c00,
                                     [LS_VALIDITY_DARK] = 0x4000,
                                     [LS_VALIDITY_GAP] = 0x4200};
    for (int v = LS_VALIDITY_OK; v <= LS_VALIDITY_GAP; v++)
        if (half == halfs[v])
            return v;
    return -1;
}

static enum ls_err read_validity(const struct ls_exr_tiles *tiles, uint32_t x, uint32_t y,
                                 uint32_t width, uint32_t height, uint8_t *out,
                                 struct ls_diag *diag)
{
    g_autofree uint16_t *row = g_try_new(uint16_t, width);
    if (!row)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    for (uint32_t j = 0; j < height; j++) {
        read_halfs(tiles, x, y + j, width, 1, row);
        for (uint32_t i = 0; i < width; i++) {
            int v = validity_of(row[i]);
            if (v < 0)
                return ls_fail(diag, LS_ERR_INVALID, "its validity at pixel %u, %u is no validity",
                               x + i, y + j);
            *out++ = (uint8_t)v;
        }
    }
    return LS_OK;
}

enum ls_err ls_picture_map_validity(const struct ls_picture_map *map, uint32_t x, uint32_t y,
                                    uint32_t width, uint32_t height, uint8_t *out,
                                    struct ls_diag *diag)
{
    struct ls_exr_tiles tiles;
    struct ls_diag inner = {0};
    enum ls_err err = ls_exr_map_tiles(map->base, map->bytes, "validity", &tiles, &inner);
    if (err == LS_ERR_NOT_FOUND) {
        memset(out, LS_VALIDITY_OK, (size_t)width * height);
        return LS_OK;
    }
    if (!err)
        err = check(&tiles, "validity", map->tiles.width, map->tiles.height, &inner);
    if (!err)
        err = read_validity(&tiles, x, y, width, height, out, &inner);
    ls_exr_tiles_finish(&tiles);
    return err ? ls_fail(diag, err, "%.300s: %.200s", map->path, inner.text) : LS_OK;
}

void ls_picture_map_read(const struct ls_picture_map *map, uint32_t x, uint32_t y, uint32_t width,
                         uint32_t height, float gain, float *out)
{
    uint16_t halfs[LS_EXR_TILE_PX];
    for (uint32_t row = y; row < y + height; row++)
        for (uint32_t col = x; col < x + width;) {
            struct run run = run_at(&map->tiles, col, row, x + width);
            memcpy(halfs, run.halfs, 2 * (size_t)run.n);
            ls_half_to_floats(halfs, out, run.n);
            for (uint32_t i = 0; i < run.n; i++)
                out[i] *= gain;
            out += run.n;
            col += run.n;
        }
}

void ls_picture_map_finish(struct ls_picture_map *map)
{
    ls_exr_tiles_finish(&map->tiles);
    ls_map_guard_remove(&map->guard);
    if (map->base)
        munmap(map->base, map->bytes);
    g_free(map->path);
    memset(map, 0, sizeof *map);
}
