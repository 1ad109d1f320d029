#include "tests/fuzz/fuzz.h"

#include <dirent.h>
#include <string.h>
#include <unistd.h>

size_t __sanitizer_get_current_allocated_bytes(void) __attribute__((weak));

static char folder[64];

static void remove_folder(void)
{
    DIR *dir = opendir(folder);
    char path[sizeof folder + 257];
    for (struct dirent *entry; dir && (entry = readdir(dir));) {
        snprintf(path, sizeof path, "%s/%s", folder, entry->d_name);
        unlink(path);
    }
    if (dir)
        closedir(dir);
    rmdir(folder);
}

const char *fuzz_folder(void)
{
    if (!*folder) {
        strcpy(folder,
               access("/dev/shm", W_OK) ? "/tmp/ls-fuzz-XXXXXX" : "/dev/shm/ls-fuzz-XXXXXX");
        HOLDS(mkdtemp(folder));
        atexit(remove_folder);
    }
    return folder;
}

void fuzz_file(const char *name, const void *bytes, size_t n)
{
    char path[sizeof folder + 64];
    snprintf(path, sizeof path, "%s/%s", fuzz_folder(), name);
    FILE *file = fopen(path, "wb");
    HOLDS(file && fwrite(bytes, 1, n, file) == n && !fclose(file));
}

char *fuzz_text(const uint8_t *data, size_t n)
{
    char *text = malloc(n + 1);
    HOLDS(text);
    if (n)
        memcpy(text, data, n);
    text[n] = 0;
    return text;
}

size_t fuzz_allocated(void)
{
    return __sanitizer_get_current_allocated_bytes ? __sanitizer_get_current_allocated_bytes() : 0;
}
