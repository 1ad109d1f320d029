/*
 * measured_spectra: published measurements as a folder of spectra that the simulator can load.
 * Layer: tests. Threads: one. Ownership: the folder is removed by measured_spectra_remove.
 *
 * White: a phosphor LED; red 632, amber 592, green 528, cyan 504, blue 450 nm: Luxeon Rebel.
 * Camera: Nikon 5100, its mono column the paper's mix. Chart: ColorChecker (Ohta). Fabrics: twelve
 * of Vrhel's objects, which the chart does not hold. What has no measurement (felt, wax, board, the
 * polariser) is the simulator's own.
 */
#ifndef LS_TESTS_SIM_MEASURED_SPECTRA_H
#define LS_TESTS_SIM_MEASURED_SPECTRA_H

#include "core/spectrum.h"

#include <glib.h>

/** A table of the measured data, or of the simulator's own folder; NULL after skipping the test. */
struct ls_spectra *measured_table(const char *relative);

/** Path of a new folder, or NULL after skipping the running test. */
char *measured_spectra_folder(void);

/** Remove and free it. NULL is allowed. */
void measured_spectra_remove(char *folder);

#endif
