/* Mistakes somebody could make between a take and a relit picture: all must be seen, by far. */
#include "tests/core/relight_take.h"

#include <math.h>
#include <string.h>

/* Each mutation is a mistake somebody could make; all must be seen by far. */
static void caught(struct take *take, const struct ls_field *mutant, gboolean mirrored)
{
    double error = relight_take_error(take, mutant, mirrored);
    g_test_message("error with the mistake %.3g", error);
    g_assert_cmpfloat(error, >, 10 * relight_take_bound(take));
    relight_take_free(take);
}

static void test_gain_applied_twice_is_caught(void)
{
    struct take *take = relight_take_new(LS_CFA_NONE, 0.3, LAYOUT_DOME);
    double k[SPECTRA * N_MAX];
    struct ls_field mutant = take->field;
    for (uint32_t j = 0; j < SPECTRA * take->n; j++)
        k[j] = take->k[j] * take->k[j];
    mutant.k = k;
    g_assert_cmpint(ls_field_check(&mutant, NULL), ==, LS_ERR_INVALID);
    caught(take, &mutant, FALSE);
}

static void test_gain_not_applied_is_caught(void)
{
    struct take *take = relight_take_new(LS_CFA_NONE, 0.3, LAYOUT_DOME);
    double one[SPECTRA * N_MAX];
    struct ls_field mutant = take->field;
    for (uint32_t j = 0; j < SPECTRA * take->n; j++)
        one[j] = 1;
    mutant.k = one;
    g_assert_cmpint(ls_field_check(&mutant, NULL), ==, LS_ERR_INVALID);
    caught(take, &mutant, FALSE);
}

/* k = 7 times too small everywhere: the shape is right, the unit is not */
static void test_gains_not_normalised_are_caught(void)
{
    struct take *take = relight_take_new(LS_CFA_NONE, 0.1, LAYOUT_DOME);
    double k[SPECTRA * N_MAX], g[SPECTRA * N_MAX];
    struct ls_field mutant = take->field;
    struct ls_diag diag = {{0}};
    for (uint32_t j = 0; j < SPECTRA * take->n; j++) {
        k[j] = take->k[j] / 7;
        g[j] = take->g[j] * 7;
    }
    mutant.k = k;
    mutant.g = g;
    g_assert_cmpint(ls_field_check(&mutant, &diag), ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, "normalise"));
    caught(take, &mutant, FALSE);
}

static void test_droop_inverted_is_caught(void)
{
    struct take *take = relight_take_new(LS_CFA_NONE, 0.1, LAYOUT_DOME);
    double factor[SPECTRA];
    struct ls_field mutant = take->field;
    for (int s = 0; s < SPECTRA; s++)
        factor[s] = 1 / take->factor[s];
    mutant.factor = factor;
    caught(take, &mutant, FALSE);
}

/* a sphere at a quarter of the duty is not a sphere of lights a quarter as strong */
static void test_duty_treated_as_gain_is_caught(void)
{
    struct take *take = relight_take_new(LS_CFA_NONE, 0.1, LAYOUT_DOME);
    double duty[SPECTRA], k[SPECTRA * N_MAX];
    struct ls_field mutant = take->field;
    for (uint32_t s = 0; s < SPECTRA; s++) {
        duty[s] = 1;
        for (uint32_t i = 0; i < take->n; i++)
            k[s * take->n + i] = take->k[s * take->n + i] / take->duty[s];
    }
    mutant.duty = duty;
    mutant.k = k;
    caught(take, &mutant, FALSE);
}

static void test_a_mirrored_environment_is_caught(void)
{
    struct take *take = relight_take_new(LS_CFA_NONE, 0.1, LAYOUT_DOME);
    caught(take, &take->field, TRUE);
}

static void test_swapped_lights_are_caught(void)
{
    struct take *take = relight_take_new(LS_CFA_NONE, 0.1, LAYOUT_DOME);
    struct ls_picture white[N_MAX];
    struct ls_field mutant = take->field;
    memcpy(white, take->white, sizeof white);
    /* the key light and the one opposite */
    uint32_t a = 0, b = 0;
    for (uint32_t i = 0; i < take->n; i++) {
        const double key[3] = {0.8, 0.6, 0};
        double now = 0, best_a = 0, best_b = 0;
        for (int c = 0; c < 3; c++) {
            now += key[c] * (double)take->direction[i][c];
            best_a += key[c] * (double)take->direction[a][c];
            best_b += key[c] * (double)take->direction[b][c];
        }
        a = now > best_a ? i : a;
        b = now < best_b ? i : b;
    }
    struct ls_picture keep = white[a];
    white[a] = white[b];
    white[b] = keep;
    mutant.white = white;
    caught(take, &mutant, FALSE);
}

static void test_numbering_from_one_is_caught(void)
{
    struct take *take = relight_take_new(LS_CFA_NONE, 0.1, LAYOUT_DOME);
    struct ls_picture white[N_MAX];
    struct ls_field mutant = take->field;
    for (uint32_t i = 0; i < take->n; i++)
        white[i] = take->white[(i + 1) % take->n];
    mutant.white = white;
    caught(take, &mutant, FALSE);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/mutation/gain-applied-twice-is-caught", test_gain_applied_twice_is_caught);
    g_test_add_func("/mutation/gain-not-applied-is-caught", test_gain_not_applied_is_caught);
    g_test_add_func("/mutation/gains-not-normalised-are-caught",
                    test_gains_not_normalised_are_caught);
    g_test_add_func("/mutation/droop-inverted-is-caught", test_droop_inverted_is_caught);
    g_test_add_func("/mutation/duty-treated-as-gain-is-caught",
                    test_duty_treated_as_gain_is_caught);
    g_test_add_func("/mutation/a-mirrored-environment-is-caught",
                    test_a_mirrored_environment_is_caught);
    g_test_add_func("/mutation/swapped-lights-are-caught", test_swapped_lights_are_caught);
    g_test_add_func("/mutation/numbering-from-one-is-caught", test_numbering_from_one_is_caught);
    return g_test_run();
}
