/*
 * chunks: where in a frame's chunk data a feature's value lies, found once, read per frame.
 * Layer: drivers. Threads: resolve where features may be walked; read on any. Ownership: plain
 * values.
 *
 * A chunk feature is a register behind a port that carries a ChunkID. Resolving follows the
 * feature's pValue links to that register; features behind formulas or computed addresses are not
 * resolved. Reading is a copy out of the buffer: RT-safe, unlike ArvChunkParser.
 */
#ifndef LS_DRIVERS_ARAVIS_CHUNKS_H
#define LS_DRIVERS_ARAVIS_CHUNKS_H

#include <arv.h>
#include <stdbool.h>
#include <stdint.h>

struct ls_aravis_chunk {
    bool found;
    bool is_float, little_endian;
    uint32_t id, offset, n_bytes; /* n_bytes: 4 or 8, and for integers 1 or 2 */
};

/** Find chunk feature @name, e.g. "ChunkExposureTime"; @chunk->found tells whether. */
void ls_aravis_chunk_resolve(ArvDevice *device, const char *name, struct ls_aravis_chunk *chunk);

/** The value in @buffer, or false if the frame carries none. RT-safe. */
bool ls_aravis_chunk_read(const struct ls_aravis_chunk *chunk, ArvBuffer *buffer, double *value);

#endif
