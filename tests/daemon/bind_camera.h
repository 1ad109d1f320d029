/*
 * bind_camera: the camera that the tests of bind bind: its rate, its patience, what it can say.
 * Layer: tests. Threads: any. Ownership: none.
 */
#ifndef LS_TESTS_DAEMON_BIND_CAMERA_H
#define LS_TESTS_DAEMON_BIND_CAMERA_H

#include "daemon/bind.h"

enum { PERIOD_US = 13889, RETENTION_US = 60000 };

static inline struct ls_bind_config bind_camera(bool by_time, bool has_counter, bool has_exposure)
{
    return (struct ls_bind_config){.by_time = by_time,
                                   .has_counter = has_counter,
                                   .has_exposure = has_exposure,
                                   .window_us = PERIOD_US / 4.0,
                                   .tight_us = 300,
                                   .event_delay_us = 10000,
                                   .patience_us = RETENTION_US + 20000,
                                   .exposure_tolerance_us = 5,
                                   .exposure_tolerance = 0.02};
}

#endif
