#include "tests/fuzz/fuzz_rig.h"

#include "tests/fuzz/fuzz.h"

#include <string.h>

enum { LIGHTS = 12 };

static const char daemon_conf[] = "storage = \"takes\"; socket = \"s\"; rig = \"rig.conf\";\n"
                                  "controller = { address = \"127.0.0.1\"; };\n";
static const char rig_conf[] =
    "lights = { positions = \"positions.csv\"; };\n"
    "channels = ( { name = \"W\"; }, { name = \"R\"; }, { name = \"V\"; kind = \"polariser\"; },\n"
    "             { name = \"H\"; kind = \"polariser\"; } );\n"
    "cameras = ( { address = \"127.0.0.1\"; pixel_format = \"BayerRG12\";\n"
    "  position_m = [0.0, 0.0, 1.5]; look_at_m = [0, 0, 0]; focal_length_mm = 50;\n"
    "  sensor_mm = [11.3, 11.3]; range = [0.1, 0.85]; black_dn = 64; full_scale_dn = 4095;\n"
    "  max_fps = 72; } );\n";

static struct ls_config *rig;

static void destroy(void)
{
    ls_config_destroy(rig);
}

const struct ls_config *fuzz_rig(void)
{
    char positions[LIGHTS * 40], path[128];
    size_t used = 0;
    if (rig)
        return rig;
    for (int i = 0; i < LIGHTS; i++) /* a ring that rises */
        used += (size_t)snprintf(positions + used, sizeof positions - used, "%d.%d,%d,%d.5\n",
                                 i % 3 - 1, i, i - 6, i % 5 - 2);
    fuzz_file("daemon.conf", daemon_conf, sizeof daemon_conf - 1);
    fuzz_file("rig.conf", rig_conf, sizeof rig_conf - 1);
    fuzz_file("positions.csv", positions, used);
    snprintf(path, sizeof path, "%s/daemon.conf", fuzz_folder());
    HOLDS(!ls_config_load(path, &rig, NULL));
    atexit(destroy);
    return rig;
}
