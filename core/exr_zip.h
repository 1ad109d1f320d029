/*
 * exr_zip: the bytes of a tile, compressed without loss, into a file that is being written.
 * Layer: core, inside the writers only. Threads: one per context. Ownership: the caller's.
 */
#ifndef LS_CORE_EXR_ZIP_H
#define LS_CORE_EXR_ZIP_H

#include <OpenEXR/openexr.h>
#include <stdint.h>

/** Compress as part @index has declared, and write, the tile in column @tx, row @ty: @bytes are as
 * an uncompressed tile's. */
exr_result_t ls_exr_zip_tile(exr_context_t context, int index, int tx, int ty, const uint8_t *bytes,
                             size_t n);

#endif
