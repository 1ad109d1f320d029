#include "daemon/take_links.h"

#include <jansson.h>
#include <math.h>

/* The last good tickets, by pointer, the newest first. */
static GPtrArray *last_tickets(const struct ls_takedir *take)
{
    GPtrArray *last = g_ptr_array_new();
    uint8_t *seen = g_new0(uint8_t, take->n_shots + 1);
    for (size_t k = take->n_tickets; k-- > 0;) {
        struct ls_ticket *ticket = &take->tickets[k];
        if (ticket->status != LS_FRAME_OK || ticket->shot >= take->n_shots || seen[ticket->shot])
            continue;
        seen[ticket->shot] = 1;
        g_ptr_array_add(last, ticket);
    }
    g_free(seen);
    return last;
}

/* Per step the condition that planned it; -1 where take.json does not say. */
static int *planned_conditions(const json_t *plan, uint32_t n_steps)
{
    int *of_step = g_new(int, n_steps + 1);
    size_t index;
    json_t *condition;
    for (uint32_t i = 0; i < n_steps; i++)
        of_step[i] = -1;
    json_array_foreach(json_object_get(plan, "conditions"), index, condition)
    {
        json_int_t first = json_integer_value(json_object_get(condition, "first_step"));
        json_int_t n = json_integer_value(json_object_get(condition, "steps"));
        for (json_int_t i = first; i >= 0 && i < first + n && i < n_steps; i++)
            of_step[i] = (int)index;
    }
    return of_step;
}

static void check_planned(const struct ls_takedir *take, const GPtrArray *last, GString *text)
{
    json_t *document = json_loads(take->take_json, 0, NULL);
    const json_t *plan = json_object_get(document, "plan");
    const json_t *pulses = json_object_get(plan, "pulse_us");
    uint32_t n_steps = take->n_cameras ? take->n_shots / take->n_cameras : 0;
    int *of_step = planned_conditions(plan, n_steps);
    for (guint i = last->len; json_object_get(plan, "conditions") && i-- > 0;) {
        const struct ls_ticket *t = last->pdata[i];
        const json_t *pulse = json_array_get(pulses, t->exposure);
        if (t->step >= n_steps || t->camera >= take->n_cameras ||
            t->shot != t->step * take->n_cameras + t->camera)
            g_string_append_printf(text, "the ticket of shot %u is of step %u, camera %u\n",
                                   t->shot, t->step, t->camera);
        else if (of_step[t->step] >= 0 && of_step[t->step] != (int)t->condition)
            g_string_append_printf(text,
                                   "the ticket of shot %u is of condition %u: planned was %d\n",
                                   t->shot, t->condition, of_step[t->step]);
        else if (pulses && fabs(json_number_value(pulse) - t->pulse_us) > 0.5)
            g_string_append_printf(text,
                                   "the ticket of shot %u asked for %g us: planned were %g us\n",
                                   t->shot, t->pulse_us, json_number_value(pulse));
    }
    g_free(of_step);
    json_decref(document);
}

/* ---- each its own ---- */

static int order(uint64_t a, uint64_t b)
{
    return (a > b) - (a < b);
}

/* A pulse is all cameras'. */
static int by_pulse(gconstpointer a, gconstpointer b)
{
    const struct ls_ticket *x = *(struct ls_ticket *const *)a, *y = *(struct ls_ticket *const *)b;
    int by_time = order(x->controller_us, y->controller_us);
    return by_time ? by_time : order(x->step, y->step);
}

/* What tells one frame of a camera from another. */
static uint64_t moment_of(const struct ls_ticket *ticket)
{
    return ticket->camera_ns ? ticket->camera_ns : ticket->host_ns;
}

static int by_frame(gconstpointer a, gconstpointer b)
{
    const struct ls_ticket *x = *(struct ls_ticket *const *)a, *y = *(struct ls_ticket *const *)b;
    int by_camera = order(x->camera, y->camera);
    return by_camera ? by_camera : order(moment_of(x), moment_of(y));
}

static void check_fired(GPtrArray *last, GString *text)
{
    g_ptr_array_sort(last, by_pulse);
    for (guint i = 1; i < last->len; i++) {
        const struct ls_ticket *a = last->pdata[i - 1], *b = last->pdata[i];
        if (a->controller_us && a->controller_us == b->controller_us && a->step != b->step)
            g_string_append_printf(text, "shots %u and %u were fired by one pulse\n", a->shot,
                                   b->shot);
    }
}

static void check_received(GPtrArray *last, GString *text)
{
    g_ptr_array_sort(last, by_frame);
    for (guint i = 1; i < last->len; i++) {
        const struct ls_ticket *a = last->pdata[i - 1], *b = last->pdata[i];
        if (moment_of(a) && by_frame(&last->pdata[i - 1], &last->pdata[i]) == 0)
            g_string_append_printf(text, "shots %u and %u have one frame\n", a->shot, b->shot);
    }
}

void ls_take_check_links(const struct ls_takedir *take, GString *text)
{
    GPtrArray *last = last_tickets(take);
    check_planned(take, last, text);
    check_fired(last, text);
    check_received(last, text);
    g_ptr_array_free(last, TRUE);
}
