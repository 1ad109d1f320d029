/*
 * export_file: one light of a take as an OpenEXR file, a part for each spectrum.
 * Layer: clients. Threads: the main thread. Ownership: the export owns the pictures of its spectra;
 * everything else is the caller's and outlives it.
 *
 * Of several spectra each is a part and a layer of the same name: channels W.R W.G W.B (a mono
 * camera's W.Y) in part W, so that programs that go by parts and those that go by channels find
 * the same. Of one alone: R G B. In the camera's own colours the values are those of a fetch, bit
 * for bit; in another space they are fetched as floats, converted, and rounded once.
 */
#ifndef LS_CLIENTS_EXPORT_FILE_H
#define LS_CLIENTS_EXPORT_FILE_H

#include "clients/export_space.h"
#include "clients/take_document.h"
#include "core/exr.h"

/** One spectrum of the light that is being written. */
struct ls_export_spectrum {
    const char *name;
    bool photographed;     /* light by light */
    float duty;            /* of those pictures, nominal; 0: there is no single one */
    struct ls_image image; /* of the light last written or found */
    struct ls_exr_attrs attrs;
    char channel_names[3][40];
    struct ls_exr_channel channels[3];
};

struct ls_export {
    struct ls_command_context *context;
    const struct ls_take_document *document;
    struct lightstage_promotion promotion; /* of what was not photographed light by light */
    bool half, packed;
    uint32_t camera;
    struct ls_export_space space;
    struct ls_export_spectrum spectra[LS_DOCUMENT_CHANNELS];
    uint32_t n_spectra;
    char recipe[512]; /* what a file must have been made by to be left as it is */
};

/** Choose the spectra: those of @list, "W,R", in the take's order, or all that the take's plan
 * suggests (NULL); and write down the recipe. The fields before spectra are filled. LS_ERR_INVALID:
 * a name that is none, no spectra. */
LS_MUST_CHECK enum ls_err ls_export_begin(struct ls_export *export, const char *list);

/** See that @light's file stands at @path: left where it is whole and of this recipe, else fetched
 * and written. Its pictures are then in the spectra. *written: it was. Errors: those of the daemon
 * and of writing. */
LS_MUST_CHECK enum ls_err ls_export_file(struct ls_export *export, uint32_t light, const char *path,
                                         bool *written);

/** Free the pictures. */
void ls_export_forget(struct ls_export *export);

#endif
