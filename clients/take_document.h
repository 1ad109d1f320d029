/*
 * take_document: what take.json says that a client needs: geometry, channels, calibration.
 * Layer: clients. Threads: the main thread. Ownership: owns everything; see destroy.
 */
#ifndef LS_CLIENTS_TAKE_DOCUMENT_H
#define LS_CLIENTS_TAKE_DOCUMENT_H

#include "clients/command.h"
#include "core/calibration.h"
#include "core/pixel.h"

#include <stdbool.h>
#include <stdint.h>

enum { LS_DOCUMENT_CHANNELS = 16, LS_DOCUMENT_LIGHTS = 4096 };

struct ls_document_camera {
    char vendor[64], model[64], serial[64];
    char lens[64];             /* empty: not said */
    float aperture, iso_speed; /* 0: not said */
    float position_m[3], look_at_m[3];
};

struct ls_take_document {
    char id[128];
    char date[40]; /* UTC, "YYYY:MM:DD hh:mm:ss"; empty if the take does not say */
    uint32_t n_lights;
    float (*position_m)[3]; /* stage frame */
    float (*direction)[3];  /* unit, towards the light */
    double *omega_sr;       /* of the cells; the calibration's, if it has one */
    uint32_t n_channels;
    struct {
        char name[32];
        bool spectrum, each, sphere, headlight, segments; /* segments: lights lit together */
        float duty; /* nominal, at which single lights were shown; 0: none were */
    } channels[LS_DOCUMENT_CHANNELS];
    struct ls_document_camera camera;
    bool mono;
    enum ls_cfa cfa;
    uint32_t width, height;
    double reference_exposure_s, longest_exposure_s;
    struct ls_calibration *calibration; /* NULL: the take has none */
};

/** Ask the daemon; @camera: whose facts are wanted. LS_EXIT_OK, or printed and its exit code. *out:
 * (transfer full). */
int ls_take_document_get(struct ls_command_context *context, const char *take, uint32_t camera,
                         struct ls_take_document **out);

/** Parse take.json. Errors: LS_ERR_INVALID naming the key, or the cameras there are; those of
 * ls_calibration_parse. */
LS_MUST_CHECK enum ls_err ls_take_document_parse(const char *text, size_t n, uint32_t camera,
                                                 struct ls_take_document **out,
                                                 struct ls_diag *diag);

/** Channels behind a vertical and a horizontal polariser: V and H where two polarisers are called
 * so, else the first two, as the daemon has it. false: there are no two. RT-safe. */
bool ls_take_document_polarisers(const struct ls_take_document *document, uint32_t *vertical,
                                 uint32_t *horizontal);

/** NULL is allowed. */
void ls_take_document_destroy(struct ls_take_document *document);

#endif
