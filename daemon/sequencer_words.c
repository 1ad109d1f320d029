#include "daemon/sequencer_run.h"

#include <stdio.h>

void ls_sequencer_fault_names(uint32_t faults, char *text, size_t size)
{
    static const char *const names[] = {"interlock open", "emergency stop", "over-temperature",
                                        "over-current",   "over-duty",      "heartbeat missed",
                                        "program memory", "over-power"};
    size_t used = 0;
    text[0] = 0;
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        if (!(faults & 1u << i) || used + 1 >= size)
            continue;
        int n = snprintf(text + used, size - used, "%s%s", used ? ", " : "", names[i]);
        used += n > 0 ? (size_t)n : 0;
    }
}

void ls_run_explain(struct ls_run *run)
{
    char faults[160];
    const char *dark = run->dark_err ? "" : "LEDs are dark; ";
    uint32_t step = run->seen;
    if (run->flash.hz > 0) {
        char what[96];
        ls_flashing_describe(&run->flash, run->seq->config, what, sizeof what);
        ls_fail(
            run->diag, run->err,
            "the live subject saw %s at step %u, more than %d flashes a second: %sfind out what "
            "delays the controller, then resume the take",
            what, step, LS_FLASHES_PER_SECOND, dark);
    } else if (run->err == LS_ERR_REFUSED && run->status.state == LS_LIGHTS_FAULT) {
        ls_sequencer_fault_names(run->status.faults, faults, sizeof faults);
        ls_fail(run->diag, run->err,
                "the light controller stopped at step %u and latched a fault (%s): clear its "
                "cause, then resume the take",
                step, faults);
    } else if (run->err == LS_ERR_REFUSED && run->granted > 0 &&
               run->status.state != LS_LIGHTS_ARMED) {
        ls_fail(run->diag, run->err,
                "the light controller was blanked by somebody else at step %u: %sresume the take",
                step, dark);
    } else if (run->err == LS_ERR_LIMIT && !run->diag->text[0]) {
        ls_fail(run->diag, run->err,
                "the dome is too hot, %d C at step %u: for %.0f s it has not cooled below the %u C "
                "from which the controller calls it hot: %slet it cool, then resume the take",
                run->status.temperature_c, step, (double)run->seq->cooling_us * 1e-6,
                ls_lights_info(run->seq->lights)->hot_c, dark);
    } else if (run->err == LS_ERR_TIMEOUT && !run->diag->text[0]) {
        ls_fail(run->diag, run->err,
                "the light controller fired nothing for %.1f s although granted %u steps, %u of "
                "them fired: %scheck it, then resume the take",
                (double)run->seq->stall_us * 1e-6, run->granted, run->seen, dark);
    } else if ((run->err == LS_ERR_TIMEOUT || run->err == LS_ERR_GONE) && run->granted > 0) {
        const struct ls_diag link = *run->diag;
        ls_fail(run->diag, run->err,
                "%.300s (step %u; %scheck its cable and power, then resume the take)", link.text,
                step, dark);
    } else if (run->err == LS_ERR_MISMATCH && !run->diag->text[0]) {
        ls_fail(run->diag, run->err,
                "the light controller reports steps out of order after step %u: %sresume the take",
                step, dark);
    } else if (run->err == LS_ERR_BUG && !run->diag->text[0]) {
        ls_fail(run->diag, run->err, "a camera thread does not answer");
    }
}

void ls_run_explain_dark(struct ls_run *run)
{
    static const char lit[] = "LEDs may be lit until the heartbeat blanks them";
    const struct ls_diag before = *run->diag;
    if (!run->err)
        run->err = ls_fail(run->diag, run->dark_err, "%.400s: %s", run->dark.text, lit);
    else
        ls_fail(run->diag, run->err, "%.260s; and blanking failed (%.150s): %s",
                before.text[0] ? before.text : ls_err_name(run->err), run->dark.text, lit);
}
