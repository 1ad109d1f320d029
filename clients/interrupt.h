/*
 * interrupt: SIGINT and SIGTERM come to the main thread, whoever they were given to.
 * Layer: clients. Threads: install on the main thread, elsewhere in a handler. Ownership: none.
 *
 * A library may run threads of its own (BLAS starts them when it is loaded). They block no signal,
 * and the kernel gives one that the main thread blocks to them: a handler then runs there, and no
 * call of the main thread's is interrupted by it.
 */
#ifndef LS_CLIENTS_INTERRUPT_H
#define LS_CLIENTS_INTERRUPT_H

#include <stdbool.h>

/** The calling thread is the main one. SIGINT and SIGTERM end the program as by default, but not
 * while that thread blocks them; a signal ignored by who started the program stays ignored. */
void ls_interrupt_install(void);

/** For a handler. True: it runs on another thread, and the signal has been sent on to the main
 * one; return. Async-signal-safe. */
bool ls_interrupt_elsewhere(int signal_number);

#endif
