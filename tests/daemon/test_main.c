/* lightstaged as a process: what it says of files it cannot use, before it listens. */
#include <glib.h>
#include <glib/gstdio.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

static const char rig_conf[] =
    "name = \"test\"; lights = { positions = \"p.csv\"; };\n"
    "channels = ( { name = \"W\"; } );\n"
    "cameras = ( { address = \"127.0.0.1\"; pixel_format = \"BayerRG12\";\n"
    "  position_m = [0.0, 0.0, 1.5]; look_at_m = [0, 0, 0]; focal_length_mm = 50;\n"
    "  sensor_mm = [11.3, 11.3]; range = [0.1, 0.85]; black_dn = 64; full_scale_dn = 4095;\n"
    "  max_fps = 72; } );\n";
static const char *const names[] = {"daemon.conf", "rig.conf", "p.csv", "calibration.json"};

struct folder {
    char *path;
};

static void write_file(const struct folder *f, const char *name, const char *text)
{
    char *path = g_build_filename(f->path, name, NULL);
    g_assert_true(g_file_set_contents(path, text, -1, NULL));
    g_free(path);
}

static void write_daemon(const struct folder *f, const char *socket, const char *extra)
{
    char *text = g_strdup_printf("storage = \"takes\"; socket = \"%s\"; rig = \"rig.conf\";\n"
                                 "controller = { address = \"127.0.0.1\"; port = 1502; };\n%s",
                                 socket, extra);
    write_file(f, "daemon.conf", text);
    g_free(text);
}

static void setup(struct folder *f, gconstpointer unused)
{
    f->path = g_dir_make_tmp("ls-main-XXXXXX", NULL);
    write_file(f, "rig.conf", rig_conf);
    write_file(f, "p.csv", "0,1.35,0\n1.35,0,0\n0,0,1.35\n");
    write_daemon(f, "s", "");
}

static void teardown(struct folder *f, gconstpointer unused)
{
    for (size_t i = 0; i < G_N_ELEMENTS(names); i++) {
        char *path = g_build_filename(f->path, names[i], NULL);
        g_unlink(path);
        g_free(path);
    }
    char *takes = g_build_filename(f->path, "takes", NULL);
    g_rmdir(takes);
    g_rmdir(f->path);
    g_free(takes);
    g_free(f->path);
}

/* @line: after the program's name, in a shell, in the folder. */
static void expect(const struct folder *f, const char *line, int code, const char *sentence)
{
    char *out = NULL, *err = NULL;
    char *words[] = {(char *)"/bin/sh", (char *)"-c", NULL, NULL};
    int status = 0;
    words[2] = g_strdup_printf("exec %s %s", g_getenv("LIGHTSTAGED"), line);
    g_assert_true(
        g_spawn_sync(f->path, words, NULL, G_SPAWN_DEFAULT, NULL, NULL, &out, &err, &status, NULL));
    g_assert_true(WIFEXITED(status));
    g_test_message("%s -> %d %s%s", line, WEXITSTATUS(status), out, err);
    g_assert_cmpint(WEXITSTATUS(status), ==, code);
    g_assert_nonnull(strstr(code ? err : out, sentence));
    g_free(words[2]);
    g_free(out);
    g_free(err);
}

static void check_reads_good_files(struct folder *f, gconstpointer unused)
{
    expect(f, "--check --config daemon.conf", 0, "good: 3 lights, 1 channels, 1 cameras");
}

static void unreadable_files_are_named_with_the_reason(struct folder *f, gconstpointer unused)
{
    expect(f, "--config none.conf", 1, "none.conf: cannot read the configuration file: No such");
    expect(f, "--config .", 1, ".: cannot read the configuration file: Is a directory");
    char *rig = g_build_filename(f->path, "rig.conf", NULL);
    g_unlink(rig);
    expect(f, "--config daemon.conf", 1, "named by key rig in daemon.conf: No such file");
    g_free(rig);
}

static void a_damaged_calibration_is_named(struct folder *f, gconstpointer unused)
{
    write_daemon(f, "s", "calibration = \"calibration.json\";\n");
    write_file(f, "calibration.json", "{\"lights\": ");
    expect(f, "--check --config daemon.conf", 1, "calibration.json: ");
}

static void check_refuses_a_socket_path_no_address_can_hold(struct folder *f, gconstpointer unused)
{
    char path[200];
    memset(path, 'x', sizeof path);
    path[0] = '/';
    path[108] = '\0'; /* sun_path has 108 bytes, with the end */
    write_daemon(f, path, "");
    expect(f, "--check --config daemon.conf", 1, "108 characters, expected 1 to 107");
    path[107] = '\0';
    write_daemon(f, path, "");
    expect(f, "--check --config daemon.conf", 0, "good");
}

static void check_leaves_the_disk_as_it_was(struct folder *f, gconstpointer unused)
{
    char *takes = g_build_filename(f->path, "takes", NULL);
    expect(f, "--check --config daemon.conf", 0, "good");
    g_assert_false(g_file_test(takes, G_FILE_TEST_EXISTS));
    write_file(f, "takes", "");
    expect(f, "--check --config daemon.conf", 1, "takes: it is no folder");
    g_free(takes);
}

static void a_storage_that_takes_no_takes_is_refused(struct folder *f, gconstpointer unused)
{
    char *takes = g_build_filename(f->path, "takes", NULL);
    write_file(f, "takes", "");
    expect(f, "--config daemon.conf", 1, "takes: it is no folder");
    g_unlink(takes);
    g_assert_cmpint(g_mkdir(takes, 0500), ==, 0);
    if (access(takes, W_OK) == 0)
        g_test_message("not tried: this user may write everywhere");
    else
        expect(f, "--config daemon.conf", 1, "takes cannot be written: Permission denied");
    g_free(takes);
}

static void a_descriptor_that_is_no_number_is_refused(struct folder *f, gconstpointer unused)
{
    expect(f, "--config daemon.conf --ready-fd out", 2, "--ready-fd out: expected the number of");
    expect(f, "--config daemon.conf --ready-fd ''", 2, "expected the number of");
}

static void an_answer_nobody_can_read_is_no_success(struct folder *f, gconstpointer unused)
{
    expect(f, "--help >&-", 1, "standard output cannot be written");
    expect(f, "--version >&-", 1, "standard output cannot be written");
    expect(f, "--check --config daemon.conf >&-", 1, "standard output cannot be written");
}

#define ADD(name, function) \
    g_test_add("/lightstaged/" name, struct folder, NULL, setup, function, teardown)

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    if (!g_getenv("LIGHTSTAGED")) {
        g_print("1..0 # SKIP LIGHTSTAGED is not set\n");
        return 0;
    }
    ADD("check-reads-good-files", check_reads_good_files);
    ADD("unreadable-files-are-named-with-the-reason", unreadable_files_are_named_with_the_reason);
    ADD("a-damaged-calibration-is-named", a_damaged_calibration_is_named);
    ADD("check-refuses-a-socket-path-no-address-can-hold",
        check_refuses_a_socket_path_no_address_can_hold);
    ADD("check-leaves-the-disk-as-it-was", check_leaves_the_disk_as_it_was);
    ADD("a-storage-that-takes-no-takes-is-refused", a_storage_that_takes_no_takes_is_refused);
    ADD("a-descriptor-that-is-no-number-is-refused", a_descriptor_that_is_no_number_is_refused);
    ADD("an-answer-nobody-can-read-is-no-success", an_answer_nobody_can_read_is_no_success);
    return g_test_run();
}
