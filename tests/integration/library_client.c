/*
 * library_client: photographs a take by liblightstage, follows it to its end and fetches two lights
 * of it, whose pixels it writes to standard output.
 *
 * usage: library_client PLAN|TAKE WHERE [CERTIFICATE KEY AUTHORITY]
 * At a socket it looks at three frames of the running take, which it writes to PLAN.frames. Of a
 * take that there is already, TAKE, it only fetches. What is refused goes to standard error, number
 * and sentence, with exit code 1.
 */
#include <lightstage.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

enum { MOST = 1 << 20, FRAMES = 3 };

/* By a connection of its own: the other one is in a callback. */
struct looker {
    struct lightstage *stage; /* NULL: it does not look */
    struct lightstage_ring *ring;
    FILE *file;
    unsigned frames;
    uint64_t number; /* of the last */
};

struct followed {
    struct looker *looker;
    unsigned calls, conditions;
    enum lightstage_take_state state;
    char take[128];
};

static double now_s(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* One more frame: each can be read for a moment only, and none after the take. */
static void look(struct looker *looker)
{
    static char frame[MOST];
    double until_s = now_s() + 10; /* a busy machine; it takes milliseconds */
    uint64_t number = 0;
    if (!looker->ring && lightstage_ring(looker->stage, 0, &looker->ring, NULL))
        return;
    if (looker->ring->payload_bytes > sizeof frame)
        return;
    while (number <= looker->number && now_s() < until_s)
        number = lightstage_ring_newest(looker->ring, frame);
    if (number <= looker->number)
        return;
    looker->number = number;
    looker->frames +=
        fwrite(frame, 1, looker->ring->payload_bytes, looker->file) == looker->ring->payload_bytes;
}

static int follow(const struct lightstage_take_status *status, void *user)
{
    struct followed *followed = user;
    followed->calls++;
    followed->conditions = status->conditions_stored;
    followed->state = status->state;
    snprintf(followed->take, sizeof followed->take, "%s", status->id);
    if (followed->looker->stage && status->state == LIGHTSTAGE_TAKE_RUNNING &&
        followed->looker->frames < FRAMES)
        look(followed->looker);
    return 0;
}

static char *read_text(const char *path)
{
    static char text[4096];
    FILE *file = fopen(path, "r");
    size_t n = file ? fread(text, 1, sizeof text - 1, file) : 0;
    text[n] = 0;
    if (file)
        fclose(file);
    return n ? text : NULL;
}

static uint32_t photograph(struct lightstage *stage, const char *plan, struct followed *followed,
                           struct lightstage_error *error)
{
    struct lightstage_status *status = NULL;
    char token[32], *document = NULL;
    snprintf(token, sizeof token, "library-%d", (int)getpid());
    uint32_t number = lightstage_take_start(stage, "by-library", token, plan, NULL, error);
    if (!number) /* the same again starts nothing */
        number = lightstage_take_start(stage, "by-library", token, plan, NULL, error);
    if (!number)
        number = lightstage_take_progress(stage, token, follow, followed, error);
    if (!number)
        number = lightstage_status(stage, &status, error);
    if (!number)
        number = lightstage_take_show(stage, followed->take, &document, error);
    if (number)
        return number;
    fprintf(stderr, "%s state %d %u conditions cameras %zu %s\n", followed->take, followed->state,
            followed->conditions, status->n_cameras,
            strstr(document, "by-library") && !strcmp(status->take->id, followed->take)
                ? "told"
                : "mistold");
    lightstage_status_free(status);
    lightstage_text_free(document);
    return 0;
}

static uint32_t fetch(struct lightstage *stage, const char *take, struct lightstage_error *error)
{
    static const uint32_t lights[] = {0, 7};
    static float pixels[MOST];
    struct lightstage_promotion sphere = {.size = sizeof sphere, .model = LIGHTSTAGE_SPHERE};
    struct lightstage_fetch wish = {.size = sizeof wish,
                                    .take = take,
                                    .channel = "R",
                                    .lights = lights,
                                    .n_lights = 2,
                                    .promotion = &sphere,
                                    .layout = LIGHTSTAGE_RGB};
    struct lightstage_shape shape;
    uint32_t number = lightstage_fetch_into(stage, &wish, pixels, sizeof pixels, &shape, error);
    if (!number)
        fwrite(pixels, sizeof *pixels,
               (size_t)shape.pictures * shape.height * shape.width * shape.components, stdout);
    return number;
}

int main(int argc, char **argv)
{
    struct lightstage_address address = {.size = sizeof address};
    struct lightstage_error error = {0};
    struct lightstage *stage = NULL;
    struct looker looker = {0};
    struct followed followed = {.looker = &looker};
    if (argc != 3 && argc != 6)
        return 2;
    address.where = argv[2];
    if (argc == 6) {
        address.certificate = argv[3];
        address.key = argv[4];
        address.authority = argv[5];
    }
    char *plan = read_text(argv[1]), path[4096];
    uint32_t number = lightstage_connect(&address, &stage, &error);
    if (!number && plan && argc == 3)
        number = lightstage_connect(&address, &looker.stage, &error);
    snprintf(path, sizeof path, "%s.frames", argv[1]);
    if (looker.stage && !(looker.file = fopen(path, "w")))
        return 2;
    if (!number && plan)
        number = photograph(stage, plan, &followed, &error);
    else if (!number)
        snprintf(followed.take, sizeof followed.take, "%s", argv[1]);
    if (!number)
        number = fetch(stage, followed.take, &error);
    lightstage_close(stage);
    lightstage_ring_free(looker.ring);
    lightstage_close(looker.stage);
    if (looker.file && fclose(looker.file))
        return 2;
    if (number)
        fprintf(stderr, "%u: %s\n", number, error.text);
    return number != 0;
}
