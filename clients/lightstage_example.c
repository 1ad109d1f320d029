/* A picture of one light, and its mean, by liblightstage:
 * cc lightstage_example.c $(pkg-config --cflags --libs lightstage) */
#include <lightstage.h>

#include <stdio.h>

int main(int argc, char **argv)
{
    static float pixels[1 << 24];
    const uint32_t light = 0;
    struct lightstage *stage = NULL;
    struct lightstage_error error;
    struct lightstage_shape shape = {0, 0, 0, 0};
    struct lightstage_address address = {.size = sizeof address};
    struct lightstage_fetch fetch = {
        .size = sizeof fetch, .lights = &light, .n_lights = 1, .layout = LIGHTSTAGE_RGB};
    double sum = 0;
    if (argc != 4) {
        fprintf(stderr, "usage: %s SOCKET TAKE CHANNEL\n", argv[0]);
        return 2;
    }
    address.where = argv[1];
    fetch.take = argv[2];
    fetch.channel = argv[3];
    uint32_t number = lightstage_connect(&address, &stage, &error);
    if (!number)
        number = lightstage_fetch_into(stage, &fetch, pixels, sizeof pixels, &shape, &error);
    lightstage_close(stage);
    if (number) {
        fprintf(stderr, "%u: %s\n", number, error.text);
        return 1;
    }
    size_t n = (size_t)shape.height * shape.width * shape.components;
    for (size_t i = 0; i < n; i++)
        sum += pixels[i];
    printf("%u x %u x %u, mean %.6g\n", shape.width, shape.height, shape.components,
           sum / (double)n);
    return 0;
}
