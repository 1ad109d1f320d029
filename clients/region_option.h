/*
 * region_option: which pixels, camera and lights, on the command line. Functions that return an int
 * return LS_EXIT_OK or LS_EXIT_USAGE, said already.
 * Layer: clients. Threads: the main thread. Ownership: the caller's.
 */
#ifndef LS_CLIENTS_REGION_OPTION_H
#define LS_CLIENTS_REGION_OPTION_H

#include "clients/lightstage.h"
#include "clients/picture_file.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/** --region X,Y,WIDTH,HEIGHT, width and height at least 1. */
int ls_region_option(const char *text, struct lightstage_region *out);

/** --level: 0 (full size) to LS_LEVEL_MAX. */
int ls_level_option(const char *text, uint32_t *out);

/** Where the pictures of a level lie that were asked for by @region. */
struct ls_picture_place ls_level_place(const struct lightstage_region *region, uint32_t level,
                                       uint32_t width, uint32_t height);

/** --camera: its number, from 0. */
int ls_camera_option(const char *text, uint32_t *out);

/** "0,5,7-9": numbers and ranges below @limit, each light once however often it is named, in the
 * order of its first naming. *out: (transfer full). */
bool ls_lights_option(const char *text, uint32_t limit, uint32_t **out, size_t *n);

#endif
