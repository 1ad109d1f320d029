/*
 * prometheus: the daemon's counters in the text format 0.0.4 of Prometheus, as its node_exporter
 * reads them from a file (prometheus.io/docs/instrumenting/exposition_formats).
 * Layer: clients. Threads: any. Ownership: as stated.
 */
#ifndef LS_CLIENTS_PROMETHEUS_H
#define LS_CLIENTS_PROMETHEUS_H

#include "clients/lightstage.h"

#include <stddef.h>

/** Cumulative counters, latencies as histograms in seconds, their quantiles as gauges. (transfer
 * full, free), NUL-terminated; NULL: out of memory. */
char *ls_prometheus_text(const struct lightstage_metrics *metrics, size_t *n);

#endif
