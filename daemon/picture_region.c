#include "daemon/picture_region.h"

struct ls_demosaic_region ls_picture_region_of(const Lightstage__Region *region)
{
    if (!region)
        return (struct ls_demosaic_region){0};
    return (struct ls_demosaic_region){region->x, region->y, region->width, region->height};
}

enum ls_err ls_picture_region_check(struct ls_demosaic_region *region, uint32_t width,
                                    uint32_t height, struct ls_diag *diag)
{
    if (region->x == 0 && region->y == 0 && region->width == 0 && region->height == 0)
        *region = (struct ls_demosaic_region){0, 0, width, height};
    if (region->width == 0 || region->height == 0 || region->x >= width || region->y >= height ||
        region->width > width - region->x || region->height > height - region->y)
        return ls_fail(diag, LS_ERR_LIMIT,
                       "region %u,%u %ux%u does not lie inside the picture of %u x %u", region->x,
                       region->y, region->width, region->height, width, height);
    return LS_OK;
}
