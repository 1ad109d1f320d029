#include "drivers/aravis/chunks.h"

#include <stdlib.h>
#include <string.h>

enum { MAX_LINKS = 4 };

static const char *child_text(ArvDomNode *node, const char *name)
{
    for (ArvDomNode *child = arv_dom_node_get_first_child(node); child;
         child = arv_dom_node_get_next_sibling(child)) {
        const char *child_name = arv_dom_node_get_node_name(child);
        ArvDomNode *text = arv_dom_node_get_first_child(child);
        if (child_name && strcmp(child_name, name) == 0 && ARV_IS_DOM_CHARACTER_DATA(text))
            return arv_dom_character_data_get_data(ARV_DOM_CHARACTER_DATA(text));
    }
    return NULL;
}

static ArvDomNode *linked(ArvGc *genicam, ArvDomNode *node, const char *link)
{
    const char *name = child_text(node, link);
    return name ? (ArvDomNode *)arv_gc_get_node(genicam, name) : NULL;
}

/** Follow pValue to the register that has the value, or NULL. */
static ArvDomNode *find_register(ArvGc *genicam, const char *name)
{
    ArvDomNode *node = (ArvDomNode *)arv_gc_get_node(genicam, name);
    for (int i = 0; node && i < MAX_LINKS; i++) {
        const char *kind = arv_dom_node_get_node_name(node);
        if (strcmp(kind, "IntReg") == 0 || strcmp(kind, "FloatReg") == 0)
            return node;
        if (strcmp(kind, "Integer") != 0 && strcmp(kind, "Float") != 0)
            return NULL;
        node = linked(genicam, node, "pValue");
    }
    return NULL;
}

static bool has_plain_address(ArvDomNode *node)
{
    return child_text(node, "Address") && !child_text(node, "pAddress") &&
           !child_text(node, "pIndex") && !child_text(node, "pLength");
}

static bool usable(const struct ls_aravis_chunk *chunk)
{
    uint32_t n = chunk->n_bytes;
    return n == 4 || n == 8 || (!chunk->is_float && (n == 1 || n == 2));
}

void ls_aravis_chunk_resolve(ArvDevice *device, const char *name, struct ls_aravis_chunk *chunk)
{
    ArvGc *genicam = arv_device_get_genicam(device);
    ArvDomNode *node = find_register(genicam, name);
    *chunk = (struct ls_aravis_chunk){0};
    if (!node || !has_plain_address(node))
        return;
    ArvDomNode *port = linked(genicam, node, "pPort");
    const char *id = port ? child_text(port, "ChunkID") : NULL;
    const char *length = child_text(node, "Length");
    const char *order = child_text(node, "Endianess");
    if (!id || !length)
        return;
    chunk->id = (uint32_t)strtoul(id, NULL, 16);
    chunk->offset = (uint32_t)strtoul(child_text(node, "Address"), NULL, 0);
    chunk->n_bytes = (uint32_t)strtoul(length, NULL, 0);
    chunk->is_float = strcmp(arv_dom_node_get_node_name(node), "FloatReg") == 0;
    chunk->little_endian = !order || strcmp(order, "LittleEndian") == 0;
    chunk->found = usable(chunk);
}

static uint64_t load(const uint8_t *bytes, uint32_t n, bool little_endian)
{
    uint64_t value = 0;
    for (uint32_t i = 0; i < n; i++)
        value = value << 8 | bytes[little_endian ? n - 1 - i : i];
    return value;
}

bool ls_aravis_chunk_read(const struct ls_aravis_chunk *chunk, ArvBuffer *buffer, double *value)
{
    size_t size = 0;
    const uint8_t *data = NULL;
    if (chunk->found && arv_buffer_has_chunks(buffer))
        data = arv_buffer_get_chunk_data(buffer, chunk->id, &size);
    if (!data || size < (size_t)chunk->offset + chunk->n_bytes)
        return false;
    uint64_t bits = load(data + chunk->offset, chunk->n_bytes, chunk->little_endian);
    uint32_t bits32 = (uint32_t)bits;
    float single;
    *value = (double)bits;
    if (chunk->is_float && chunk->n_bytes == 8)
        memcpy(value, &bits, 8);
    if (chunk->is_float && chunk->n_bytes == 4) {
        memcpy(&single, &bits32, 4);
        *value = (double)single;
    }
    return true;
}
