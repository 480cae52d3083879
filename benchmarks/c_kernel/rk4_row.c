/* One classical Runge-Kutta step of the paper's row after another, written by hand for this row alone.
 *
 * Three buildings of three storeys, whose floors meet at all three levels: 9 degrees of freedom, 6 contacts, linear
 * contact law. Scenarios lie side by side in vectors of WIDTH doubles. The arithmetic is that of the package's `rk4`
 * with `locate = false`: with stage accelerations a1 ... a4
 *
 *     u += h v + h^2/6 (a1 + a2 + a3),     v += h/6 (a1 + 2 a2 + 2 a3 + a4),
 *
 * the contact force follows the sign of the penetration at every stage, and peaks and onsets are sampled at the ends
 * of steps. It is the bar for the package's generated kernel: everything that may change between scenes (storeys,
 * contacts, law, outputs) is fixed here, and the compiler may reorder at will (-ffast-math).
 *
 * Units: kN, t, m, s.
 */

#ifndef WIDTH
#define WIDTH 8 /* lanes of one vector */
#endif
#define LANES 16 /* scenarios of one group in memory */
#define BUILDINGS 3
#define STOREYS 3
#define FLOORS (BUILDINGS * STOREYS)
#define PAIRS (BUILDINGS - 1)
#define CONTACTS (PAIRS * STOREYS)

#if LANES % WIDTH
#error "WIDTH must divide LANES"
#endif

typedef double vec __attribute__((vector_size(8 * WIDTH)));
typedef long long mask __attribute__((vector_size(8 * WIDTH)));

/* What all lanes share. Storeys run from the bottom up, building by building. */
typedef struct {
    double inverse_mass[FLOORS];
    double stiffness[FLOORS];
    double alpha[BUILDINGS]; /* Rayleigh damping: alpha M + beta K */
    double beta[BUILDINGS];
} row_t;

/* What one vector of scenarios brings: gaps (m), contact stiffness (kN/m), factor on the record. */
typedef struct {
    vec gap[PAIRS];
    vec stiffness;
    vec scale;
} lanes_t;

static inline vec larger(vec a, vec b) {
    mask first = a > b;
    return (vec)(((mask)a & first) | ((mask)b & ~first));
}

static inline vec smaller(vec a, vec b) {
    mask first = a < b;
    return (vec)(((mask)a & first) | ((mask)b & ~first));
}

/* Zero where a is negative. */
static inline vec positive(vec a) {
    return (vec)((mask)a & (mask)(a > 0.0));
}

/* The lanes of one quantity. */
static inline vec load(const double *from) {
    vec to;
    __builtin_memcpy(&to, from, sizeof to);
    return to;
}

static inline void store(double *to, vec from) {
    __builtin_memcpy(to, &from, sizeof from);
}

/* Accelerations relative to the ground, and contact forces, of a state. */
static inline __attribute__((always_inline)) void accelerate(const row_t *row, const lanes_t *lanes, vec ground,
                                                             const vec u[FLOORS], const vec v[FLOORS],
                                                             vec a[FLOORS], vec force[CONTACTS]) {
    vec net[FLOORS];
    for (int b = 0; b < BUILDINGS; b++) {
        for (int s = 0; s < STOREYS; s++) {
            int i = b * STOREYS + s;
            vec drift = s ? u[i] - u[i - 1] : u[i];
            vec rate = s ? v[i] - v[i - 1] : v[i];
            vec pull = row->stiffness[i] * (drift + row->beta[b] * rate);
            net[i] = -pull;
            if (s) net[i - 1] += pull;
        }
    }
    for (int p = 0; p < PAIRS; p++) {
        for (int s = 0; s < STOREYS; s++) {
            int left = p * STOREYS + s, right = left + STOREYS;
            vec push = lanes->stiffness * positive(u[left] - u[right] - lanes->gap[p]);
            force[left] = push; /* a contact has the number of its left floor */
            net[left] -= push;
            net[right] += push;
        }
    }
    for (int i = 0; i < FLOORS; i++)
        a[i] = net[i] * row->inverse_mass[i] - row->alpha[i / STOREYS] * v[i] - ground;
}

typedef struct {
    vec highest[FLOORS], lowest[FLOORS], force[CONTACTS], onsets[CONTACTS], closed[CONTACTS];
} peaks_t;

/* Force peaks and onsets: a contact is closed where its force is positive. */
static inline void watch(peaks_t *peaks, const vec force[CONTACTS]) {
    const vec one = 1.0 - (vec){0};
    for (int j = 0; j < CONTACTS; j++) {
        vec now = (vec)((mask)one & (mask)(force[j] > 0.0));
        peaks->force[j] = larger(peaks->force[j], force[j]);
        peaks->onsets[j] += positive(now - peaks->closed[j]);
        peaks->closed[j] = now;
    }
}

static void run_lanes(const row_t *row, const lanes_t *lanes, const double *ground, long points, double dt, long steps,
                      peaks_t *peaks) {
    vec u[FLOORS] = {0}, v[FLOORS] = {0}, x[FLOORS], y[FLOORS];
    vec a1[FLOORS], a2[FLOORS], a3[FLOORS], a4[FLOORS], force[CONTACTS], unused[CONTACTS];
    const double h = dt / steps, half = 0.5 * h, sixth = h / 6.0;
    for (long i = 0; i + 1 < points; i++) {
        const double slope = (ground[i + 1] - ground[i]) / steps;
        for (long j = 0; j < steps; j++) {
            const vec g0 = lanes->scale * (ground[i] + slope * j), g1 = g0 + lanes->scale * slope;
            const vec gm = 0.5 * (g0 + g1);
            accelerate(row, lanes, g0, u, v, a1, force);
            watch(peaks, force); /* of the end of the step before, which costs no evaluation of its own */
            for (int f = 0; f < FLOORS; f++) {
                x[f] = u[f] + half * v[f];
                y[f] = v[f] + half * a1[f];
            }
            accelerate(row, lanes, gm, x, y, a2, unused);
            for (int f = 0; f < FLOORS; f++) {
                x[f] += half * half * a1[f];
                y[f] = v[f] + half * a2[f];
            }
            accelerate(row, lanes, gm, x, y, a3, unused);
            for (int f = 0; f < FLOORS; f++) {
                x[f] = u[f] + h * v[f] + h * half * a2[f];
                y[f] = v[f] + h * a3[f];
            }
            accelerate(row, lanes, g1, x, y, a4, unused);
            for (int f = 0; f < FLOORS; f++) {
                u[f] += h * v[f] + h * sixth * (a1[f] + a2[f] + a3[f]);
                v[f] += sixth * (a1[f] + 2.0 * (a2[f] + a3[f]) + a4[f]);
                peaks->highest[f] = larger(peaks->highest[f], u[f]);
                peaks->lowest[f] = smaller(peaks->lowest[f], u[f]);
            }
        }
    }
    accelerate(row, lanes, lanes->scale * ground[points - 1], u, v, a1, force);
    watch(peaks, force);
}

/* Run groups of LANES scenarios over a record of `points` values (m/s2), `steps` steps to each interval dt (s).
 *
 * scales (groups, LANES), gaps (groups, PAIRS, LANES), stiffnesses (groups, LANES); out: highest and lowest
 * (groups, FLOORS, LANES), forces and onsets (groups, CONTACTS, LANES).
 */
void run(const row_t *row, const double *ground, long points, double dt, long steps, long groups, const double *scales,
         const double *gaps, const double *stiffnesses, double *highest, double *lowest, double *forces,
         double *onsets) {
    for (long part = 0; part < groups * (LANES / WIDTH); part++) {
        const long group = part / (LANES / WIDTH), lane = part % (LANES / WIDTH) * WIDTH;
        lanes_t lanes;
        lanes.scale = load(scales + group * LANES + lane);
        lanes.stiffness = load(stiffnesses + group * LANES + lane);
        for (int p = 0; p < PAIRS; p++) lanes.gap[p] = load(gaps + (group * PAIRS + p) * LANES + lane);
        peaks_t peaks = {0};
        run_lanes(row, &lanes, ground, points, dt, steps, &peaks);
        for (int f = 0; f < FLOORS; f++) {
            store(highest + (group * FLOORS + f) * LANES + lane, peaks.highest[f]);
            store(lowest + (group * FLOORS + f) * LANES + lane, peaks.lowest[f]);
        }
        for (int j = 0; j < CONTACTS; j++) {
            store(forces + (group * CONTACTS + j) * LANES + lane, peaks.force[j]);
            store(onsets + (group * CONTACTS + j) * LANES + lane, peaks.onsets[j]);
        }
    }
}
