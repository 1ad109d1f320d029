#include "clients/interrupt.h"

#include <pthread.h>
#include <signal.h>
#include <stddef.h>

static pthread_t main_thread; /* written once, before the first handler */

bool ls_interrupt_elsewhere(int signal_number)
{
    if (pthread_equal(pthread_self(), main_thread))
        return false;
    pthread_kill(main_thread, signal_number);
    return true;
}

static void end(int signal_number)
{
    if (ls_interrupt_elsewhere(signal_number))
        return;
    signal(signal_number, SIG_DFL);
    raise(signal_number);
}

void ls_interrupt_install(void)
{
    static const int signals[] = {SIGINT, SIGTERM};
    struct sigaction action = {.sa_handler = end, .sa_flags = SA_RESTART}, before;
    main_thread = pthread_self();
    sigemptyset(&action.sa_mask);
    for (size_t i = 0; i < sizeof signals / sizeof *signals; i++)
        if (!sigaction(signals[i], NULL, &before) && before.sa_handler != SIG_IGN)
            sigaction(signals[i], &action, NULL);
}
