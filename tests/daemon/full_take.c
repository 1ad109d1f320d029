#include "tests/daemon/full_take.h"

#include "core/bases.h"
#include "core/envlights.h"
#include "core/half.h"
#include "daemon/store.h"
#include "tests/daemon/store_fixture.h"

#include <jansson.h>
#include <math.h>
#include <string.h>

static const char *const names[FULL_CHANNELS] = {"W", "R", "G", "V", "H"};
static const double reference_s = 0.01;

/* ---- patterns ---- */

static const struct pattern {
    const char *name;
    int level;
    double factor;
} patterns[] = {{"sphere", 728, 1.2},
                {"segments-3", 16384, 1.05},
                {"headlight", 21845, 1.03},
                {"multiplex", 10922, 1.1}};

static const struct pattern *pattern_of(const char *name)
{
    for (size_t i = 0; i < G_N_ELEMENTS(patterns); i++)
        if (strcmp(patterns[i].name, name) == 0)
            return &patterns[i];
    g_assert_not_reached();
}

double full_take_factor(const char *pattern)
{
    const struct pattern *p = pattern_of(pattern);
    return p->factor / (p->level / 65535.0);
}

/* ---- calibration ---- */

static void fill_lights(struct ls_calibration *cal, struct full_take *take)
{
    GRand *random = g_rand_new_with_seed(5);
    double omega[FULL_LIGHTS];
    for (int i = 0; i < FULL_LIGHTS; i++) {
        double z = 1 - 2 * (i + 0.5) / FULL_LIGHTS, a = 2.4 * i, r = sqrt(1 - z * z);
        double d[3] = {r * cos(a), r * sin(a), z};
        for (int x = 0; x < 3; x++) {
            cal->direction[i][x] = (float)d[x];
            cal->position_m[i][x] = (float)(1.35 * d[x]);
        }
    }
    g_assert_cmpint(ls_envlights_omega((const float(*)[3])cal->direction, FULL_LIGHTS, omega, NULL),
                    ==, LS_OK);
    for (int c = 0; c < FULL_CHANNELS; c++) {
        double g[FULL_LIGHTS], mean = 0;
        for (int i = 0; i < FULL_LIGHTS; i++)
            mean += (g[i] = g_rand_double_range(random, 0.9, 1.1)) / FULL_LIGHTS;
        for (int i = 0; i < FULL_LIGHTS; i++) {
            cal->k[c * FULL_LIGHTS + i] = (float)(mean / g[i]);
            cal->sigma_k[c * FULL_LIGHTS + i] = 0.001f;
            cal->omega_sr[i] = (float)omega[i];
            take->k[c][i] = (double)cal->k[c * FULL_LIGHTS + i];
        }
    }
    g_rand_free(random);
}

static void fill_colours(struct ls_calibration *cal, struct full_take *take,
                         const struct full_take_options *options)
{
    GRand *random = g_rand_new_with_seed(6);
    uint32_t colours = cal->n_colours;
    if (options->coloured || options->white_coloured || options->ones)
        cal->k_colour = calloc((size_t)FULL_CHANNELS * FULL_LIGHTS * colours, sizeof(float));
    for (int c = 0; c < FULL_CHANNELS; c++)
        for (uint32_t x = 0; x < 3; x++) {
            bool white = c == FULL_CW || c == FULL_CV;
            bool differs = (options->coloured && (white || c == FULL_CR)) ||
                           (options->white_coloured && white);
            double drawn[FULL_LIGHTS], mean = 0; /* of g, which is 1 with the factors too */
            for (int i = 0; i < FULL_LIGHTS; i++) {
                drawn[i] = differs ? g_rand_double_range(random, 0.97, 1.03) : 1;
                mean += 1 / (drawn[i] * take->k[c][i]) / FULL_LIGHTS;
            }
            for (int i = 0; i < FULL_LIGHTS; i++) {
                float factor = differs ? (float)(drawn[i] * mean) : 1;
                take->colour[c][i][x] = (double)factor;
                if (cal->k_colour && (colours == 3 || x == 1))
                    cal->k_colour[(c * FULL_LIGHTS + i) * colours + (colours == 3 ? x : 0)] =
                        factor;
            }
        }
    g_rand_free(random);
}

static void fill_patterns(struct ls_calibration *cal, bool spheres_only)
{
    size_t n = spheres_only ? 1 : G_N_ELEMENTS(patterns);
    for (size_t i = 0; i < n; i++)
        for (uint32_t c = 0; c < FULL_CHANNELS; c++) {
            struct ls_calibration_pattern p = {
                .channel = c, .duty = patterns[i].level / 65535.0, .factor = patterns[i].factor};
            g_strlcpy(p.pattern, patterns[i].name, sizeof p.pattern);
            g_assert_cmpint(ls_calibration_put_factor(cal, &p, NULL), ==, LS_OK);
        }
}

/* What light i's coat keeps of vertical light. */
static double kept(const struct full_take_options *options, int i)
{
    return options->polarisation ? 0.9 + 0.02 * (i % 5) : 0.9;
}

static void fill_polarisation(struct ls_calibration *cal, const struct full_take_options *options)
{
    g_assert_cmpint(ls_calibration_add_polarisation(cal, 1, NULL), ==, LS_OK);
    for (int i = 0; i < FULL_LIGHTS; i++) {
        cal->a_v[i] = (float)kept(options, i);
        cal->a_h[i] = 1 - cal->a_v[i];
    }
}

static const double white_p[3] = {0.8, 1, 0.7}, red_p[3] = {0.9, 0.3, 0.05};

static struct ls_calibration *calibrate(struct full_take *take,
                                        const struct full_take_options *options)
{
    struct ls_calibration *cal = NULL;
    uint32_t colours = options->mono ? 1 : 3;
    g_assert_cmpint(ls_calibration_create(FULL_LIGHTS, FULL_CHANNELS, colours, &cal, NULL), ==,
                    LS_OK);
    fill_lights(cal, take);
    fill_colours(cal, take, options);
    fill_patterns(cal, options->sphere_factors_only);
    if (options->polarisation)
        fill_polarisation(cal, options);
    for (int c = 0; c < FULL_CHANNELS; c++) {
        g_strlcpy(cal->channels[c].name, names[c], sizeof cal->channels[c].name);
        cal->channels[c].polariser = c >= FULL_CV;
        for (uint32_t x = 0; x < colours; x++) {
            uint32_t y = options->mono ? 1 : x;
            cal->p[c][x] = (float)(c == FULL_CR   ? red_p[y]
                                   : c == FULL_CG ? 0.5 * white_p[y]
                                                  : white_p[y] * (c >= FULL_CV ? 0.5 : 1));
        }
    }
    cal->scale = 0.02;
    cal->camera.full_scale_dn = 4095;
    cal->camera.black_dn = 100;
    cal->camera.electrons_per_dn = 10;
    cal->camera.read_noise_dn = 2;
    cal->camera.range_low = 0.1;
    cal->camera.range_high = 0.85;
    g_strlcpy(cal->camera.cfa, options->mono ? "mono" : "RG", sizeof cal->camera.cfa);
    g_strlcpy(cal->camera.pixel_format, options->mono ? "Mono12" : "BayerRG12",
              sizeof cal->camera.pixel_format);
    return cal;
}

/* ---- take.json ---- */

static json_t *lights_json(int first, int step, int n)
{
    json_t *list = json_array();
    for (int i = 0; i < n; i++)
        json_array_append_new(list, json_integer(first + i * step));
    return list;
}

static void add(json_t *list, GPtrArray *ids, json_t *condition)
{
    g_ptr_array_add(ids, g_strdup(json_string_value(json_object_get(condition, "id"))));
    json_array_append_new(list, condition);
}

static json_t *patterned(const char *id, const char *kind, int channel, const char *pattern)
{
    return json_pack("{ss ss ss ss si si}", "id", id, "kind", kind, "channel", names[channel],
                     "pattern", pattern, "level", pattern_of(pattern)->level, "repeats", 1);
}

static bool is_each(const struct full_take_options *options, int channel, int light)
{
    bool white = !options->polarised_only && !options->multiplexed;
    return channel >= FULL_CV || (channel == FULL_CW && white) ||
           (channel == FULL_CG && options->mono_two) ||
           (channel == FULL_CR &&
            ((options->some_red && light < FULL_HEAD) || options->red_lights == FULL_LIGHTS ||
             (light % 2 == 1 && light / 2 < options->red_lights)));
}

static json_t *row_json(int row)
{
    uint8_t on[FULL_ORDER];
    char id[32];
    json_t *lights = json_array();
    g_snprintf(id, sizeof id, "multiplex-W-%04d", row);
    ls_multiplex_row(FULL_ORDER, (uint32_t)row, on);
    for (int i = 0; i < FULL_LIGHTS; i++)
        if (on[i])
            json_array_append_new(lights, json_integer(i));
    json_t *condition = patterned(id, "segment", FULL_CW, "multiplex");
    json_object_set_new(condition, "lights", lights);
    json_object_set_new(condition, "part", json_integer(row));
    json_object_set_new(condition, "parts", json_integer(FULL_ORDER));
    return condition;
}

static json_t *conditions_json(const struct full_take_options *options, GPtrArray *ids)
{
    json_t *list = json_array();
    char id[32];
    add(list, ids,
        json_pack("{ss ss si si}", "id", "dark-0", "kind", "dark", "repeats", 16, "exposure", 0));
    for (int c = 0; c < FULL_CHANNELS; c++)
        for (int i = 0; i < FULL_LIGHTS; i++) {
            if (!is_each(options, c, i))
                continue;
            g_snprintf(id, sizeof id, "%s-%04d", names[c], i);
            add(list, ids,
                json_pack("{ss ss si ss si si}", "id", id, "kind", "one", "light", i, "channel",
                          names[c], "level", 65535, "repeats", 1));
        }
    add(list, ids, patterned("sphere-W", "sphere", FULL_CW, "sphere"));
    add(list, ids, patterned("sphere-R", "sphere", FULL_CR, "sphere"));
    for (int q = 0; q < FULL_SEGMENTS; q++) {
        g_snprintf(id, sizeof id, "segment-R-%02d", q);
        json_t *condition = patterned(id, "segment", FULL_CR, "segments-3");
        json_object_set_new(condition, "lights",
                            lights_json(q, FULL_SEGMENTS, FULL_LIGHTS / FULL_SEGMENTS));
        add(list, ids, condition);
    }
    for (int row = 0; row < FULL_ORDER && options->multiplexed; row++)
        add(list, ids, row_json(row));
    json_t *head = patterned("headlight-R", "segment", FULL_CR, "headlight");
    json_object_set_new(head, "lights", lights_json(0, 1, FULL_HEAD));
    add(list, ids, head);
    return list;
}

static json_t *rig_json(const struct ls_calibration *cal)
{
    json_t *positions = json_array(), *channels = json_array();
    for (int i = 0; i < FULL_LIGHTS; i++)
        json_array_append_new(positions, json_pack("[fff]", (double)cal->position_m[i][0],
                                                   (double)cal->position_m[i][1],
                                                   (double)cal->position_m[i][2]));
    for (int c = 0; c < FULL_CHANNELS; c++)
        json_array_append_new(channels, json_pack("{ssss}", "name", names[c], "kind",
                                                  c >= FULL_CV ? "polariser" : "spectrum"));
    return json_pack("{ss s{so} so s[{ss ss si si sf sf sf s[fff]}]}", "name", "test", "lights",
                     "position_m", positions, "channels", channels, "cameras", "name", "front",
                     "pixel_format", cal->camera.pixel_format, "width", FULL_W, "height", FULL_H,
                     "full_scale_dn", 4095.0, "electrons_per_dn", 10.0, "read_noise_dn", 2.0,
                     "position_m", 0.1, 0.05, 3.0);
}

static char *take_json(const struct ls_calibration *cal, const struct full_take_options *options,
                       GPtrArray *ids)
{
    char *text = NULL;
    g_assert_cmpint(ls_calibration_write(cal, &text, NULL), ==, LS_OK);
    json_t *doc = json_pack("{s{sssssoso} so s[ff] sf so}", "plan", "text", "x", "subject", "still",
                            "pulse_us", json_array(), "conditions", conditions_json(options, ids),
                            "rig", rig_json(cal), "exposure_s", 0.002, 0.01, "reference_exposure_s",
                            reference_s, "calibration", json_loads(text, 0, NULL));
    g_assert_nonnull(doc);
    free(text);
    text = json_dumps(doc, JSON_REAL_PRECISION(17));
    json_decref(doc);
    return text;
}

/* ---- pictures ---- */

static float as_half(double value)
{
    return ls_half_to_float(ls_half_from_float((float)value));
}

/* What a pixel sees of light i: diffuse under W or R, and what the coat mirrors, in R = k E. */
static double diffuse(const struct full_take_options *options, int i, int p, bool red, int colour)
{
    int x = p % FULL_W, y = p / FULL_W;
    double shade = 0.3 + 0.2 * sin(0.05 * x + i) + 0.1 * cos(0.04 * y - 2 * i);
    double albedo = 0.5 + 0.3 * sin(0.03 * x + 0.02 * y + colour);
    double turn = options->green_like_red ? 2 * M_PI / FULL_SEGMENTS : 0.5;
    double tint = red ? red_p[colour] * (0.8 + 0.3 * sin(0.02 * y + turn * i)) : white_p[colour];
    return albedo * shade * tint;
}

static double coat(const struct full_take_options *options, int i, int p, bool red, int colour)
{
    double d = hypot(p % FULL_W - 12.0 * (i % 12), p / FULL_W - 70.0), bright = 0.2;
    if (options->glint && i == FULL_GLINT && d < 8)
        bright = 200;
    return bright * exp(-0.002 * d * d) * (red ? red_p[colour] : white_p[colour]);
}

int full_take_colour_at(int p, bool mono)
{
    int x = p % FULL_W, y = p / FULL_W;
    return mono ? 1 : x % 2 + y % 2; /* RGGB */
}

double full_take_reflected(const struct full_take_options *options, int channel, int i, int p)
{
    int c = full_take_colour_at(p, options->mono);
    bool red = channel == FULL_CR;
    if (channel == FULL_CG)
        return 0.5 *
               (diffuse(options, i, p, options->green_like_red, c) +
                coat(options, i, p, options->green_like_red, c)) *
               (0.9 + 0.2 * sin(0.03 * (p % FULL_W)));
    if (channel < FULL_CV)
        return diffuse(options, i, p, red, c) + coat(options, i, p, red, c);
    double share = channel == FULL_CV ? kept(options, i) : 1 - kept(options, i);
    return 0.5 * diffuse(options, i, p, false, c) + share * coat(options, i, p, false, c);
}

static double lit(const struct full_take *take, const struct full_take_options *options,
                  int channel, int i, int p)
{
    int c = full_take_colour_at(p, options->mono);
    return full_take_reflected(options, channel, i, p) /
           (take->k[channel][i] * take->colour[channel][i][c]);
}

static void make_pixels(struct full_take *take, const struct full_take_options *options)
{
    for (int p = 0; p < FULL_PIXELS; p++) {
        double sphere[2] = {0}, segment[FULL_SEGMENTS] = {0}, head = 0;
        for (int i = 0; i < FULL_LIGHTS; i++) {
            for (int c = 0; c < FULL_CHANNELS; c++)
                take->light[c][i][p] = as_half(lit(take, options, c, i, p));
            double red = lit(take, options, FULL_CR, i, p);
            sphere[0] += lit(take, options, FULL_CW, i, p);
            sphere[1] += red;
            segment[i % FULL_SEGMENTS] += red;
            head += i < FULL_HEAD ? red : 0;
        }
        take->sphere[FULL_CW][p] = as_half(sphere[0] / full_take_factor("sphere"));
        take->sphere[FULL_CR][p] = as_half(sphere[1] / full_take_factor("sphere"));
        for (int q = 0; q < FULL_SEGMENTS; q++)
            take->segment[q][p] = as_half(segment[q] / full_take_factor("segments-3"));
        take->head[p] = as_half(head / full_take_factor("headlight"));
    }
}

/* The supply sags by so much per light beyond the first that rows have the factor on average. */
static void make_rows(struct full_take *take, const struct full_take_options *options)
{
    const struct pattern *pattern = pattern_of("multiplex");
    double mean = FULL_LIGHTS * (FULL_ORDER + 1) / (2.0 * FULL_ORDER);
    for (uint32_t row = 0; row < FULL_ORDER; row++) {
        uint8_t on[FULL_ORDER];
        int n = 0;
        ls_multiplex_row(FULL_ORDER, row, on);
        for (int i = 0; i < FULL_LIGHTS; i++)
            n += on[i];
        double droop = 1 + (pattern->factor - 1) / (mean - 1) * (n - 1);
        for (int p = 0; p < FULL_PIXELS; p++) {
            double sum = 0;
            for (int i = 0; i < FULL_LIGHTS; i++)
                sum += on[i] ? lit(take, options, FULL_CW, i, p) : 0;
            take->row[row][p] =
                as_half(sum * pattern->level / 65535.0 / droop + (double)options->ambient);
        }
    }
}

/* ---- on disk ---- */

static const float *pixels_of(const struct full_take *take, const char *id)
{
    for (int c = 0; c < FULL_CHANNELS; c++)
        if (id[0] == names[c][0] && id[1] == '-')
            return take->light[c][atoi(id + 2)];
    if (g_str_has_prefix(id, "multiplex-W-"))
        return take->row[atoi(id + 12)];
    if (g_str_has_prefix(id, "segment-R-"))
        return take->segment[atoi(id + 10)];
    if (g_str_has_prefix(id, "sphere-"))
        return take->sphere[id[7] == 'W' ? FULL_CW : FULL_CR];
    return strcmp(id, "headlight-R") ? NULL : take->head;
}

static void publish_one(struct ls_store *store, const struct full_take *take, const char *id)
{
    const float *pixels = pixels_of(take, id);
    float *zero = g_new0(float, FULL_PIXELS);
    uint16_t *half = g_new(uint16_t, FULL_PIXELS);
    struct ls_store_picture picture = {.condition = id,
                                       .mosaic = {.width = FULL_W, .height = FULL_H}};
    ls_half_from_floats(pixels ? pixels : zero, half, FULL_PIXELS);
    picture.mosaic.half = pixels ? half : NULL;
    picture.mosaic.floats = pixels ? NULL : zero;
    g_assert_cmpint(ls_store_publish(store, &picture, NULL), ==, LS_OK);
    g_free(half);
    g_free(zero);
}

static void write_take(struct full_take *take, const char *json, const GPtrArray *ids)
{
    struct ls_store *store = NULL;
    struct ls_diag diag = {0};
    const struct ls_store_config config = {.root = take->root,
                                           .name = "full",
                                           .take_json = json,
                                           .utc_s = 1767323045,
                                           .n_cameras = 1,
                                           .n_shots = ids->len,
                                           .conditions = (const char *const *)ids->pdata,
                                           .n_conditions = ids->len,
                                           .need_bytes = 1 << 20};
    const struct ls_store_end end = {.state = LS_STORE_COMPLETE};
    g_assert_cmpint(ls_store_create(&config, &store, &diag), ==, LS_OK);
    take->id = g_strdup(ls_store_id(store));
    for (guint i = 0; i < ids->len; i++) {
        const struct ls_ticket ticket = {.shot = i, .step = i, .condition = i};
        g_assert_cmpint(ls_store_ticket(store, &ticket, NULL), ==, LS_OK);
        publish_one(store, take, ids->pdata[i]);
    }
    g_assert_cmpint(ls_store_set_state(store, &end, &diag), ==, LS_OK);
    g_assert_cmpint(ls_store_close(store, &diag), ==, LS_OK);
}

struct full_take *make_full_take(const struct full_take_options *options)
{
    struct full_take *take = g_new0(struct full_take, 1);
    GPtrArray *ids = g_ptr_array_new_with_free_func(g_free);
    take->root = new_root();
    take->calibration = calibrate(take, options);
    take->scale = take->calibration->scale / reference_s;
    char *json = take_json(take->calibration, options, ids);
    make_pixels(take, options);
    if (options->multiplexed)
        make_rows(take, options);
    write_take(take, json, ids);
    free(json);
    g_ptr_array_unref(ids);
    return take;
}

void full_take_free(struct full_take *take)
{
    remove_tree(take->root);
    ls_calibration_destroy(take->calibration);
    g_free(take->root);
    g_free(take->id);
    g_free(take);
}
