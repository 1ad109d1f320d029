/*
 * capture_fixture: whole takes against a rig of fakes behind the drivers' interfaces; the real
 * ring, binding, merge and store. Layer: tests. Threads: the test's one, and the capture's own.
 * Ownership: new_stage / clear.
 *
 * A take of N_LIGHTS lights, one channel, a bracket of N_EXPOSURES, darks first. A test changes
 * options (and watches) of a new stage, shoots, and looks at what is left.
 */
#ifndef LS_TESTS_CAPTURE_FIXTURE_H
#define LS_TESTS_CAPTURE_FIXTURE_H

#include "daemon/capture.h"
#include "daemon/metrics.h"
#include "daemon/store.h"
#include "daemon/takedir.h"
#include "tests/daemon/fake_rig.h"

enum {
    N_LIGHTS = 16,
    N_EXPOSURES = 3,
    N_DARKS = 3, /* per exposure */
    N_STEPS = N_EXPOSURES * (N_LIGHTS + N_DARKS),
    N_ALL = N_EXPOSURES + N_LIGHTS,
    N_WATCHES = 2, /* where a test wants them: one after each half of the lights */
    WATCH_FRAMES = 4,
    MAX_ALL = N_ALL + N_WATCHES,
    MAX_STEPS = N_STEPS + N_WATCHES * WATCH_FRAMES,
    PERIOD_US = 3000,
    FIRST_LIGHT = N_EXPOSURES * N_DARKS, /* its first step */
};

#define REFERENCE_S 1e-3

/** The pulse of a light in a take of timed exposures, which is shot exposure by exposure with a
 * pulse to settle before each but the first; @repaired pulses of the exposures before were shot
 * again. Faults are counted by it. */
static inline int timed_pulse(int light, int exposure, int repaired)
{
    int settling = N_EXPOSURES - 1 + exposure + 1;
    return FIRST_LIGHT + settling + exposure * N_LIGHTS + repaired + light;
}

struct stage {
    char *root, *folder;
    struct fake_options options;
    struct fake_rig *rig;
    struct ls_config config;
    struct ls_config_light lights[N_LIGHTS];
    struct ls_plan plan;
    bool watches, live;
    int n_lights; /* N_LIGHTS, unless a test wants a shorter take */
    uint16_t work_level;
    struct ls_plan_condition conditions[MAX_ALL];
    struct ls_plan_step steps[MAX_STEPS];
    struct ls_led leds[N_LIGHTS];
    const char *ids[MAX_ALL];
    struct ls_disk_shim shim;
    struct ls_store *store;
    struct ls_metrics metrics;
    struct ls_capture_setup setup;
    struct ls_capture *capture;
    struct ls_capture_report report;
    struct ls_diag diag;
    uint8_t done[MAX_ALL];
    float *darks[N_EXPOSURES];
};

/** One camera, no faults, no watches, raw frames kept. */
struct stage *new_stage(void);

/** Config and plan. */
void describe(struct stage *s);

/** These, rig and store. */
void prepare(struct stage *s);

/** Prepare, and a capture ready to run. */
void set_up(struct stage *s);

/** Set up and run; the rig must be dark afterwards and its rings never full. */
enum ls_err shoot(struct stage *s);

/** Run what an earlier run left undone, as after a restart: no more than that is shot. The earlier
 * run may have been another process's: a stage that was only described, with its folder. */
void resume(struct stage *s);

/** Every kept frame shows what its ticket says it shows; returns how many do not. */
uint32_t count_mislabeled(struct stage *s, const struct ls_takedir *take);

/** A published picture has the value its light gives, and says which light that is. */
void check_picture(struct stage *s, const struct ls_takedir *take, uint32_t condition,
                   uint32_t camera);

/** All there, all right, nothing confused. */
void expect_complete(struct stage *s);

void clear(struct stage *s);

#endif
