/* fuzz_rig: a rig of twelve lights, four channels and one camera for targets that need one. */
#ifndef LS_TESTS_FUZZ_RIG_H
#define LS_TESTS_FUZZ_RIG_H

#include "daemon/config.h"

/** Made at the first call, kept until exit. */
const struct ls_config *fuzz_rig(void);

#endif
