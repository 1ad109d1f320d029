/*
 * weights_fixture: environments whose weights are known, on the made rig, whose spectra are known.
 * Layer: tests. Threads: the test's. Ownership: what is returned is the caller's to finish.
 */
#ifndef LS_TESTS_CLIENTS_WEIGHTS_FIXTURE_H
#define LS_TESTS_CLIENTS_WEIGHTS_FIXTURE_H

#include "clients/light_weights.h"

/** The document of a made take, with the made calibration or with none. */
struct ls_take_document *weights_document(bool calibrated);

/** One lobe, the same from everywhere, radiance 2, the spectrum of LED channel @channel. */
struct ls_environment_file weights_lit_by(int channel);

/** 32 x 16 pixels of linear Rec. 709. */
struct ls_environment_file weights_constant_map(float r, float g, float b);

/** Solved for the full sphere's model, as the camera reads the map (@tristimulus) or spectrally.
 * @environment: (transfer full). */
struct ls_light_weights weights_solved(const struct ls_take_document *document,
                                       struct ls_environment_file *environment, bool tristimulus);

/** Every light of @row within @tolerance of @radiance times its solid angle. */
void weights_assert_row(const struct ls_light_weights *weights, uint32_t row, const double *omega,
                        double radiance, double tolerance);

#endif
