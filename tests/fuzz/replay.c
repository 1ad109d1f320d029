/* replay: a target without libFuzzer: every file named, and every file of a folder named. */
#include "tests/fuzz/fuzz.h"

#include <dirent.h>
#include <string.h>

static int replay(const char *path)
{
    static const size_t most = 1 << 20; /* as run.py tells libFuzzer */
    FILE *file = fopen(path, "rb");
    uint8_t *bytes = malloc(most);
    HOLDS(file && bytes);
    size_t n = fread(bytes, 1, most, file);
    fclose(file);
    uint8_t *exact = malloc(n ? n : 1); /* a checker of memory sees every byte past its end */
    HOLDS(exact);
    memcpy(exact, bytes, n);
    free(bytes);
    LLVMFuzzerTestOneInput(exact, n);
    free(exact);
    return 1;
}

static int replay_folder(DIR *dir, const char *path)
{
    int n = 0;
    for (struct dirent *entry; (entry = readdir(dir));) {
        char child[4096];
        if (entry->d_name[0] == '.')
            continue;
        snprintf(child, sizeof child, "%s/%s", path, entry->d_name);
        n += replay(child);
    }
    closedir(dir);
    return n;
}

int main(int argc, char **argv)
{
    int n = 0;
    for (int i = 1; i < argc; i++) {
        DIR *dir = opendir(argv[i]);
        n += dir ? replay_folder(dir, argv[i]) : replay(argv[i]);
    }
    printf("%d inputs\n", n);
    return n ? 0 : 1;
}
