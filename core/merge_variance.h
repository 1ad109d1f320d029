/*
 * merge_variance: the variance of merged estimates, told from the estimates alone.
 * Layer: core. Threads: any. Ownership: the caller's.
 *
 * Source: core/merge.h, Var E = 1 / sum_S w' t with S and w' at the estimate. What the merge itself
 * gives has both at its pooled estimate, which differs from E by a part of E's own noise only; so a
 * take need not hold a second picture beside each of its pictures.
 *
 * Accuracy: within 1e-6 of ls_merge_rows' variance, relative, where no exposure is in range; where
 * shot noise rules it is off by at most as much as E is by its own noise (E of SNR 50: 2 % rms of a
 * pixel, below 0.1 % of the mean over 4000). At an edge of the range the merge may have used one
 * exposure more or less than this: of exposures 4 apart a factor of 5 (shot noise) to 17 (read
 * noise) at the upper edge, at most 1.25 at the lower. Of a pixel that
 * ls_merge_rows replaced as defective it is the variance of an ordinary pixel that reads the same,
 * up to three times its own (that of a mean of one to three neighbours).
 */
#ifndef LS_CORE_MERGE_VARIANCE_H
#define LS_CORE_MERGE_VARIANCE_H

#include "core/merge.h"

/**
 * @params: as they were for ls_merge_rows; format, width, height and defects are not looked at.
 * @black_dn: mean dark of these pixels, which says with E where an exposure lay in the range.
 * @e: n estimates in full scale / s; @variance: (full scale / s)^2, > 0. RT-safe.
 */
void ls_merge_variance(const struct ls_merge_params *params, double black_dn, const float *e,
                       size_t n, float *variance);

#endif
