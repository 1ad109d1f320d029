#include "daemon/flashing.h"

#include "daemon/bracket.h"

#include <stdio.h>
#include <string.h>
#include <strings.h>

enum { SECOND_US = 1000000, RED_FROM_NM = 600 };

#define RED_SHARE 0.8 /* of a saturated red's light lies beyond RED_FROM_NM */

static bool is_red(const struct ls_config_channel *channel)
{
    double all = 0, red = 0;
    if (channel->polariser)
        return false;
    if (!channel->spectrum)
        return !strcasecmp(channel->name, "R") || !strcasecmp(channel->name, "red");
    for (int i = 0; i < LS_SPECTRUM_N; i++) {
        all += channel->spectrum->v[i];
        if (LS_SPECTRUM_FIRST_NM + i * LS_SPECTRUM_STEP_NM >= RED_FROM_NM)
            red += channel->spectrum->v[i];
    }
    return all > 0 && red >= RED_SHARE * all;
}

static double energy(const struct ls_flashing *f, const struct ls_condition *c, uint32_t width_us)
{
    double levels = 0;
    for (uint32_t k = 0; k < c->n_leds; k++)
        levels += c->leds[k].level;
    return levels * width_us * (c->kind == LS_CONDITION_SPHERE ? f->n_lights : 1);
}

void ls_flashing_init(struct ls_flashing *f, const struct ls_plan *plan,
                      const struct ls_config *config, const struct ls_lights_info *lights)
{
    *f = (struct ls_flashing){.n_lights = lights->n_lights};
    for (uint32_t i = 0; i < config->n_channels; i++)
        f->red_channels |= (uint32_t)is_red(&config->channels[i]) << i;
    for (uint32_t i = 0; i < plan->n_steps; i++) {
        const struct ls_plan_step *step = &plan->steps[i];
        double e =
            energy(f, &plan->conditions[step->condition].lights, plan->pulse_us[step->exposure]);
        f->brightest = e > f->brightest ? e : f->brightest;
    }
}

/* Light came at @us: how often it flashes, 0 if not dangerously. */
static double follow(struct ls_flash_train *t, uint64_t us)
{
    bool flash = !t->begun || us - t->last_us >= LS_FLASH_FUSED_US;
    t->begun = true;
    t->last_us = us;
    if (!flash)
        return 0;
    uint64_t *oldest = &t->flash_us[t->n_flashes % LS_FLASHES_PER_SECOND];
    uint64_t passed_us = us - *oldest;
    bool often = t->n_flashes >= LS_FLASHES_PER_SECOND && passed_us <= SECOND_US;
    *oldest = us;
    t->n_flashes++;
    return often ? (double)LS_FLASHES_PER_SECOND * SECOND_US / (double)passed_us : 0;
}

static bool follow_all(struct ls_flashing *f, uint32_t trains, uint64_t us,
                       struct ls_flash_found *found)
{
    bool flashes = false;
    for (uint32_t i = 0; i < LS_FLASH_TRAINS; i++) {
        double hz = trains >> i & 1 ? follow(&f->trains[i], us) : 0;
        if (hz > 0 && !flashes)
            *found = (struct ls_flash_found){i, hz};
        flashes |= hz > 0;
    }
    return flashes;
}

bool ls_flashing_pulse(struct ls_flashing *f, uint64_t us, uint32_t width_us,
                       const struct ls_condition *c, struct ls_flash_found *found)
{
    uint32_t trains = 1u << LS_FLASH_PULSES;
    if (c->n_leds == 0)
        return false;
    if (f->shown != c->leds)
        trains |= 1u << LS_FLASH_CHANGES;
    if (2 * energy(f, c, width_us) >= f->brightest)
        trains |= 1u << LS_FLASH_BRIGHT;
    for (uint32_t k = 0; k < c->n_leds; k++) {
        uint32_t channel = c->leds[k].channel;
        if (channel < LS_MAX_CHANNELS)
            trains |= 1u << (LS_FLASH_CHANNEL + channel) | (f->red_channels >> channel & 1)
                                                               << LS_FLASH_RED;
    }
    f->shown = c->leds;
    return follow_all(f, trains, us, found);
}

void ls_flashing_describe(const struct ls_flash_found *found, const struct ls_config *config,
                          char *text, size_t size)
{
    static const char *const what[] = {"pulses", "lights change", "bright pulses", "red flash"};
    if (found->train < LS_FLASH_CHANNEL)
        snprintf(text, size, "%s at %.1f Hz", what[found->train], found->hz);
    else
        snprintf(text, size, "channel %s flash at %.1f Hz",
                 config->channels[found->train - LS_FLASH_CHANNEL].name, found->hz);
}

static enum ls_err refuse(const struct ls_plan *plan, const struct ls_config *config,
                          const struct ls_flash_found *found, struct ls_diag *diag)
{
    char what[96];
    ls_flashing_describe(found, config, what, sizeof what);
    return ls_fail(diag, LS_ERR_REFUSED,
                   "a live subject would see %s (%u exposure%s at %.1f Hz): more than %d flashes a "
                   "second, up to 30 Hz, are dangerous; use fewer exposures, shorten exposures or "
                   "period, or set allow_flashing = true",
                   what, plan->n_exposures, plan->n_exposures == 1 ? "" : "s",
                   1e6 / plan->period_us, LS_FLASHES_PER_SECOND);
}

/* From the start of a step to that of the next: drivers/lights.h. */
static uint64_t gap_us(const struct ls_plan *plan, uint32_t step)
{
    uint64_t gap = (uint64_t)plan->pulse_us[plan->steps[step].exposure] + plan->settle_us;
    return gap > plan->period_us ? gap : plan->period_us;
}

/* Does it flash from @us on? How long the dark before the next round lasts nobody knows: it is
 * taken to be the shortest that is seen. */
static bool round_flashes(struct ls_flashing *f, const struct ls_plan *plan, uint32_t round,
                          uint64_t *us, struct ls_flash_found *found)
{
    for (uint32_t i = 0; i < plan->n_steps; i++) {
        const struct ls_plan_step *step = &plan->steps[i];
        if (!ls_bracket_in_round(plan, round, i))
            continue;
        if (ls_flashing_pulse(f, *us, plan->pulse_us[step->exposure],
                              &plan->conditions[step->condition].lights, found))
            return true;
        *us += gap_us(plan, i);
    }
    if (plan->bracket == LS_BRACKET_OUTERMOST)
        *us += LS_FLASH_FUSED_US;
    return false;
}

enum ls_err ls_flashing_check(const struct ls_plan *plan, const struct ls_config *config,
                              const struct ls_lights_info *lights, bool stepwise,
                              struct ls_diag *diag)
{
    struct ls_flashing f;
    struct ls_flash_found found;
    uint64_t us = SECOND_US;
    if (plan->subject != LS_SUBJECT_LIVE || plan->allow_flashing)
        return LS_OK;
    if (stepwise && (uint64_t)plan->period_us * LS_FLASHES_PER_SECOND < SECOND_US)
        return ls_fail(diag, LS_ERR_REFUSED,
                       "a live subject would see pulses at no fixed pace: a camera without line "
                       "trigger or timestamps is driven one step at a time, which can be 3 to 30 "
                       "Hz; use period_us = %u, or set allow_flashing = true",
                       SECOND_US / LS_FLASHES_PER_SECOND + 1);
    ls_flashing_init(&f, plan, config, lights);
    for (uint32_t round = 0; round < ls_bracket_rounds(plan); round++)
        if (round_flashes(&f, plan, round, &us, &found))
            return refuse(plan, config, &found, diag);
    return LS_OK;
}
