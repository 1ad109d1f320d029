/* lightstagectl: wrong command lines, and the way to and from a daemon. */
#include "tests/clients/ctl_fixture.h"

#include <stdio.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

static void wrong_command_lines_end_with_2_and_a_sentence(void)
{
    static const struct {
        const char *line, *sentence;
    } cases[] = {
        {"", "usage:"},
        {"nonsense", "no such command"},
        {"take", "usage: lightstagectl take COMMAND"},
        {"pki", "pki init"},
        {"take fly", "take fly: no such command"},
        {"--nonsense status", "unrecognized option"},
        {"status extra", "expected 0 arguments, found 1"},
        {"status --nonsense", "unrecognized option"},
        {"preflight", "--plan FILE is needed"},
        {"preflight --plan /nonexistent", "/nonexistent: No such file"},
        {"take start", "--plan FILE is needed"},
        {"take start --plan", "requires an argument"},
        {"take start --plan /tmp", "expected a file"},
        {"take start --plan x --token ''", "1 to 63 characters"},
        {"take show", "expected 1 argument, found 0"},
        {"take resume", "expected 1 argument, found 0"},
        {"take resume x --name y", "those of the take"},
        {"fetch x", "--channel NAME and --output PREFIX are needed"},
        {"fetch x --channel W --output p --region 1,2,3", "X,Y,WIDTH,HEIGHT"},
        {"fetch x --channel W --output p --region 1,2,3,0", "X,Y,WIDTH,HEIGHT"},
        {"fetch x --channel W --output p --layout blue", "mosaic, rgb or mono"},
        {"fetch x --channel W --output p --max-error -1", "expected more than 0"},
        {"fetch x --channel W --output p --max-error nan", "expected more than 0"},
        {"fetch x --channel W --output p --max-error 1 --validity", "leave out --validity"},
        {"fetch x --channel W --output p --camera left", "the number of a camera"},
        {"fetch x --channel W --output p --full-sphere --lights 0", "leave out --lights"},
        {"fetch x --channel R --output p --model sphere", "add --layout rgb"},
        {"fetch x --channel R --output p --model linear --layout rgb --estimate",
         "leave out --model linear"},
        {"fetch x --channel R --output p --full-sphere --model sphere --layout rgb",
         "leave out --model sphere"},
        {"fetch x --channel W --output p --layout rgb --validity", "of photographed pixels"},
        {"fetch x --channel R,A --output p --layout rgb --model sphere --factored", "--half"},
        {"fetch x --channel R,A --output p --layout rgb --half --factored", "sphere or headlight"},
        {"fetch x --channel W --output p --coefficients harmonics --variance",
         "of photographed pixels"},
        {"relight x y --output z --camera -1", "the number of a camera"},
        {"nonsense --help", "no such command"},
        {"relight x", "expected a TAKE and one ENVIRONMENT or more"},
        {"relight x y", "--output FILE.exr or --png FILE.png is needed"},
        {"relight x y --output z --solve magic", "spectral, tristimulus"},
        {"relight x y --output z --model magic", "separated or linear"},
        {"relight x y --output z --reference white", "strengths or paper"},
        {"fetch x --channel W --output p --model magic", "separated or linear"},
        {"relight x y --output z --rotate north", "expected degrees"},
        {"relight x --weights y --output z --solve tristimulus", "strengths already"},
        {"relight x --weights y --output z --cells smooth", "strengths already"},
        {"relight x y --output z --space xyz", "rec709-linear or camera-raw"},
        {"relight x y --output z --max-error -1", "0 or more"},
        {"relight x y --output z --tikhonov -1", "0 or more, of the mean diagonal"},
        {"relight x y --output z --tikhonov inf", "0 or more, of the mean diagonal"},
        {"relight x y --output z --solve tristimulus --tikhonov 1", "solves nothing"},
        {"relight x y --output z --row-weights /nonexistent", "--row-weights /nonexistent"},
        {"relight x --weights y --output z --tikhonov 1", "strengths already"},
        {"metrics --output x", "goes with --prometheus"},
        {"preview --light W", "goes with --exposure"},
        {"preview --exposure 0", "1 to 1000000 us"},
        {"preview --exposure 9 --level 101", "at most 100"},
        {"preview --frames 0", "1 or more"},
        {"preview --camera left", "the number of a camera"},
    };
    for (size_t i = 0; i < G_N_ELEMENTS(cases); i++)
        expect("/nonexistent/socket", cases[i].line, 2, cases[i].sentence);
}

static void what_a_picture_is_lit_with_is_not_written_over(void)
{
    static const char *const lines[] = {
        "relight x %s/1.hdr --output %s/1.hdr",
        "relight x %s/1.hdr --output %s/none.exr --png %s/1.hdr",
        "relight x %s/1.hdr --output %s/link.exr",
        "relight x %s/2.hdr %s/1.hdr --output %s/%%d.hdr",
        "relight x --weights %s/1.hdr --output %s/1.hdr",
    };
    char *folder = g_dir_make_tmp("kept-XXXXXX", NULL), *bytes = NULL;
    char *path[3] = {g_build_filename(folder, "1.hdr", NULL),
                     g_build_filename(folder, "2.hdr", NULL),
                     g_build_filename(folder, "link.exr", NULL)};
    g_assert_true(g_file_set_contents(path[0], "light", -1, NULL));
    g_assert_true(g_file_set_contents(path[1], "light", -1, NULL));
    g_assert_cmpint(symlink("1.hdr", path[2]), ==, 0);
    for (size_t i = 0; i < G_N_ELEMENTS(lines); i++) {
        GString *line = g_string_new(lines[i]);
        g_string_replace(line, "%s", folder, 0);
        g_string_replace(line, "%%", "%", 0);
        expect("/nonexistent/socket", line->str, 2, "lit with, which is kept");
        g_string_free(line, TRUE);
    }
    g_assert_true(g_file_get_contents(path[0], &bytes, NULL, NULL));
    g_assert_cmpstr(bytes, ==, "light");
    for (size_t i = 0; i < G_N_ELEMENTS(path); i++) {
        g_assert_cmpint(unlink(path[i]), ==, 0);
        g_free(path[i]);
    }
    g_assert_cmpint(rmdir(folder), ==, 0);
    g_free(folder);
    g_free(bytes);
}

static void every_command_explains_itself(void)
{
    static const char *const names[] = {"status",     "rig",       "preflight",   "take start",
                                        "take list",  "take show", "take verify", "take resume",
                                        "take abort", "fetch",     "relight",     "blank",
                                        "take slate", "metrics",   "preview"};
    expect("x", "--help", 0, "Exit status");
    for (size_t i = 0; i < G_N_ELEMENTS(names); i++) {
        char *line = g_strdup_printf("%s --help", names[i]);
        expect("x", line, 0, names[i]);
        g_free(line);
    }
    expect("x", "take --help", 0, "take resume");
}

static void an_answer_nobody_can_read_is_no_success(void)
{
    static const char *const lines[] = {"--help", "--version", "fetch --help", "take --help"};
    for (size_t i = 0; i < G_N_ELEMENTS(lines); i++) {
        char *line = g_strdup_printf("sh -c '$LIGHTSTAGECTL %s >&-'", lines[i]), *err = NULL;
        int status = 0;
        g_assert_true(g_spawn_command_line_sync(line, NULL, &err, &status, NULL));
        g_assert_true(WIFEXITED(status));
        g_assert_cmpint(WEXITSTATUS(status), ==, 2);
        g_assert_nonnull(strstr(err, "standard output: cannot be written"));
        g_free(err);
        g_free(line);
    }
}

static void no_daemon_ends_with_3(void)
{
    expect("/nonexistent/socket", "status", 3, "no lightstaged answers at /nonexistent/socket");
    expect("/nonexistent/socket", "take list --json", 3,
           "start it, or name its socket with --socket");
    expect("x", "--server localhost status", 3, "expected tls://HOST:PORT");
}

static void reading_commands_speak_json(struct stage *stage, gconstpointer data)
{
    char *preflight = g_strdup_printf("preflight --plan %s/plan --json", stage->folder);
    expect(stage->socket_path, "status --json", 0, "\"serial\": \"DOME-1\"");
    expect(stage->socket_path, "--json rig", 0, "\"lights_m\"");
    expect(stage->socket_path, "take list --json", 0, "\"takes\": []");
    expect(stage->socket_path, preflight, 0, "\"shots\": 18");
    expect(stage->socket_path, "blank", 0, "lights are off");
    g_free(preflight);
}

static void metrics_are_told_as_text_json_and_prometheus(struct stage *stage, gconstpointer data)
{
    struct ls_camera_metrics *camera = &fake_engine_metrics(stage->engine)->cameras[0];
    camera->frames_bound = 99;
    camera->frames_discarded[LS_BIND_STALE] = 3;
    for (int i = 0; i < 99; i++)
        ls_histogram_add(&camera->latencies[LS_LATENCY_FRAME], i < 98 ? 1 << 20 : 50000000);
    expect(stage->socket_path, "metrics", 0, "99 frames bound");
    expect(stage->socket_path, "metrics", 0, "3 frames discarded: late");
    expect(stage->socket_path, "metrics", 0, "50.00");
    expect(stage->socket_path, "metrics --json", 0, "\"frames_bound\": 99");
    expect(stage->socket_path, "metrics --prometheus", 0,
           "lightstage_frames_discarded_total{camera=\"front\",reason=\"late\"} 3\n");
    expect(stage->socket_path, "metrics --prometheus", 0,
           "lightstage_latency_seconds_bucket{camera=\"front\",part=\"frame\",le=\"0.001048575\"} "
           "0\n");
    expect(stage->socket_path, "metrics --prometheus", 0,
           "lightstage_latency_seconds_bucket{camera=\"front\",part=\"frame\",le=\"0.002097151\"} "
           "98\n");
    expect(stage->socket_path, "metrics --prometheus", 0,
           "part=\"frame\",quantile=\"1\"} 0.050000000\n");
    expect(stage->socket_path, "metrics --prometheus --output /nonexistent/x", 2, "/nonexistent");
}

static void refusals_end_with_their_class(struct stage *stage, gconstpointer data)
{
    static const struct {
        enum ls_err err;
        int code;
        const char *words;
    } cases[] = {{LS_ERR_INVALID, 4, "(107 bad argument)"},
                 {LS_ERR_BUSY, 5, "(201 busy)"},
                 {LS_ERR_REFUSED, 6, "(302 refused)"},
                 {LS_ERR_FULL, 7, "(401 storage full)"},
                 {LS_ERR_BUG, 8, "(500 internal error)"}};
    char *line = start_line(stage, "--no-wait");
    for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
        engine_will_answer(stage, cases[i].err);
        expect(stage->socket_path, line, cases[i].code, cases[i].words);
    }
    expect(stage->socket_path, "take abort", 5, "no take is running");
    expect(stage->socket_path, "take show nothing", 5, "(202 not found)");
    g_free(line);
}

static void a_token_starts_once_from_two_processes(struct stage *stage, gconstpointer data)
{
    char *line = start_line(stage, "--no-wait --token mine --json");
    expect(stage->socket_path, line, 0, "\"already\": false");
    expect(stage->socket_path, line, 0, "\"already\": true");
    g_assert_cmpuint(engine_state(stage).started, ==, 1);
    g_free(line);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    if (!g_getenv("LIGHTSTAGECTL")) {
        puts("1..0 # SKIP LIGHTSTAGECTL is not set");
        return 0;
    }
    g_test_add_func("/lightstagectl/wrong-command-lines-end-with-2-and-a-sentence",
                    wrong_command_lines_end_with_2_and_a_sentence);
    g_test_add_func("/lightstagectl/what-a-picture-is-lit-with-is-not-written-over",
                    what_a_picture_is_lit_with_is_not_written_over);
    g_test_add_func("/lightstagectl/every-command-explains-itself", every_command_explains_itself);
    g_test_add_func("/lightstagectl/an-answer-nobody-can-read-is-no-success",
                    an_answer_nobody_can_read_is_no_success);
    g_test_add_func("/lightstagectl/no-daemon-ends-with-3", no_daemon_ends_with_3);
    ADD("reading-commands-speak-json", reading_commands_speak_json);
    ADD("metrics-are-told-as-text-json-and-prometheus",
        metrics_are_told_as_text_json_and_prometheus);
    ADD("refusals-end-with-their-class", refusals_end_with_their_class);
    ADD("a-token-starts-once-from-two-processes", a_token_starts_once_from_two_processes);
    return g_test_run();
}
