#include "sim/controller_books.h"

#include <stdlib.h>
#include <string.h>

enum { FULL = 65535, SECOND_US = 1000000 };

bool sim_books_init(struct sim_books *b, const struct sim_controller_config *config)
{
    *b = (struct sim_books){0};
    b->on = calloc((size_t)config->n_lights * config->n_channels, sizeof *b->on);
    return b->on;
}

static void forget(struct sim_books *b, uint32_t n)
{
    for (uint32_t i = 0; i < n; i++) {
        free(b->shown[i].leds);
        free(b->shown[i].levels);
    }
    b->n -= n;
    if (n)
        memmove(b->shown, b->shown + n, b->n * sizeof *b->shown);
}

/* Of one that cannot be kept the simulation would be wrong: it ends. */
static void *must_have(void *memory)
{
    if (!memory)
        abort();
    return memory;
}

static void forget_before(struct sim_books *b, uint64_t us)
{
    uint32_t n = 0;
    while (n < b->n && b->shown[n].start_us + SECOND_US <= us)
        n++;
    forget(b, n);
}

static struct sim_shown *append(struct sim_books *b, uint64_t start_us, uint32_t n_leds)
{
    forget_before(b, start_us);
    if (b->n == b->room) {
        b->room = 2 * b->room + 16;
        b->shown = must_have(realloc(b->shown, b->room * sizeof *b->shown));
    }
    struct sim_shown *shown = &b->shown[b->n++];
    *shown = (struct sim_shown){.start_us = start_us, .n_leds = n_leds};
    shown->leds = must_have(calloc(n_leds + 1, sizeof *shown->leds));
    shown->levels = must_have(calloc(n_leds + 1, sizeof *shown->levels));
    return shown;
}

void sim_books_note(struct sim_books *b, const struct sim_controller_config *config,
                    const struct sim_program *program, uint32_t condition, uint16_t arm,
                    uint64_t start_us, uint32_t width_us)
{
    const struct sim_condition *c = &program->conditions[condition];
    struct sim_shown *shown = append(b, start_us, (uint32_t)c->n_leds);
    shown->width_us = width_us;
    shown->arm = arm;
    for (uint32_t i = 0; i < shown->n_leds; i++) {
        shown->leds[i] = c->leds[i].light * config->n_channels + c->leds[i].channel;
        shown->levels[i] = program->levels[condition][i];
    }
}

void sim_books_note_work(struct sim_books *b, const struct sim_controller_config *config,
                         uint16_t channel, uint16_t level, uint16_t arm, uint64_t us,
                         uint64_t width_us)
{
    struct sim_shown *shown = append(b, us, config->n_lights);
    shown->width_us = width_us < SECOND_US ? (uint32_t)width_us : SECOND_US;
    shown->arm = arm;
    for (uint32_t i = 0; i < shown->n_leds; i++) {
        shown->leds[i] = i * config->n_channels + channel;
        shown->levels[i] = level;
    }
}

/* With what [from, n) have shown, is all within its limit? */
static bool has_room(const struct sim_books *b, const struct sim_controller_config *config,
                     const struct sim_program *program, const struct sim_step *step, uint32_t from)
{
    const struct sim_condition *c = &program->conditions[step->condition];
    uint64_t limit = config->max_duty_permille * 1000ull * FULL;
    uint64_t total = step->pulse_us * program->total[step->condition];
    memset(b->on, 0, (size_t)config->n_lights * config->n_channels * sizeof *b->on);
    for (uint32_t i = from; i < b->n; i++)
        for (uint32_t k = 0; k < b->shown[i].n_leds; k++) {
            uint64_t on = (uint64_t)b->shown[i].width_us * b->shown[i].levels[k];
            b->on[b->shown[i].leds[k]] += on;
            total += on;
        }
    for (uint32_t k = 0; k < c->n_leds; k++) {
        uint64_t on = (uint64_t)step->pulse_us * program->levels[step->condition][k];
        if (on && b->on[c->leds[k].light * config->n_channels + c->leds[k].channel] + on > limit)
            return false;
    }
    return !program->total[step->condition] ||
           (double)total / FULL / SECOND_US * config->led_power_mw <= config->max_power_mw;
}

static bool has_others(const struct sim_books *b, uint16_t arm, uint32_t from)
{
    for (uint32_t i = from; i < b->n; i++)
        if (b->shown[i].arm != arm)
            return true;
    return false;
}

uint64_t sim_books_start(struct sim_books *b, const struct sim_controller_config *config,
                         const struct sim_program *program, const struct sim_step *step,
                         uint16_t arm, uint64_t start_us)
{
    uint32_t from = 0;
    forget_before(b, start_us);
    for (; has_others(b, arm, from) && !has_room(b, config, program, step, from); from++)
        if (b->shown[from].start_us + SECOND_US > start_us)
            start_us = b->shown[from].start_us + SECOND_US;
    return start_us;
}

void sim_books_clear(struct sim_books *b)
{
    forget(b, b->n);
}

void sim_books_finish(struct sim_books *b)
{
    forget(b, b->n);
    free(b->shown);
    free(b->on);
}
