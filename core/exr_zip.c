#include "core/exr_zip.h"

#include <string.h>

struct packed {
    const uint8_t *bytes;
    size_t n;
};

/* In place of the library's packing, into memory that it has made as large as the tile is. */
static exr_result_t take_packed(exr_encode_pipeline_t *encode)
{
    const struct packed *packed = encode->encoding_user_data;
    if (encode->packed_alloc_size < packed->n)
        return EXR_ERR_OUT_OF_MEMORY;
    memcpy(encode->packed_buffer, packed->bytes, packed->n);
    encode->packed_bytes = packed->n;
    return EXR_ERR_SUCCESS;
}

/* The library chooses how to compress and write only where it could pack. */
static exr_result_t choose(exr_const_context_t context, int index, struct packed *packed,
                           exr_encode_pipeline_t *encode)
{
    for (int c = 0; c < encode->channel_count; c++) {
        encode->channels[c].encode_from_ptr = packed->bytes;
        encode->channels[c].user_bytes_per_element = encode->channels[c].bytes_per_element;
        encode->channels[c].user_data_type = encode->channels[c].data_type;
    }
    exr_result_t r = exr_encoding_choose_default_routines(context, index, encode);
    encode->encoding_user_data = packed;
    encode->convert_and_pack_fn = take_packed;
    return r;
}

exr_result_t ls_exr_zip_tile(exr_context_t context, int index, int tx, int ty, const uint8_t *bytes,
                             size_t n)
{
    struct packed packed = {bytes, n};
    exr_encode_pipeline_t encode = EXR_ENCODE_PIPELINE_INITIALIZER;
    exr_chunk_info_t chunk = {0};
    exr_result_t r = exr_write_tile_chunk_info(context, index, tx, ty, 0, 0, &chunk);
    if (!r)
        r = exr_encoding_initialize(context, index, &chunk, &encode);
    if (!r)
        r = choose(context, index, &packed, &encode);
    if (!r)
        r = exr_encoding_run(context, index, &encode);
    exr_encoding_destroy(context, &encode);
    return r;
}
