// The robots of the paper's ring by hand, nobody attacked: Dormand-Prince 5(4), a vector over the vehicles.
//
// Twelve vehicles, gain (1, 3, 3), a navigator weight of 0.1, 30 s with positions every 0.1 s, at rtol 1e-7 and
// atol 1e-9; steps end at output times. The law is solved at every stage with the inverse of L, computed once.
//
// gcc -O3 -march=native -ffast-math -fopenmp nonlinear_loop.c -o nonlinear_loop -lm
// ./nonlinear_loop LANES prints lanes per second, of starts as in jaxnet's default study, by a generator of its own.
// ./nonlinear_loop LANES STARTS POSITIONS reads states at t = 0, (lanes, 6, 12) in float64: x, y, heading, speed,
// turn rate, force; and it writes positions, (lanes, 301, 12, 2).
#include <math.h>
#include <omp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define M 12
#define PAD 16  // vehicles of a vector; the last four stand apart and are never read
#define OUTPUTS 300
#define STAGES 7
#define HALF_TURN 3.141592653589793

typedef double Row[PAD] __attribute__((aligned(64)));
typedef Row State[6];

static const double INTERVAL = 0.1, RTOL = 1e-7, ATOL = 1e-9, NAVIGATOR = 0.1, NEIGHBOUR = 0.45;
static const double AMPLITUDE[2] = {100, 50}, FREQUENCY[2] = {0.2, 0.4};
static const double NODE[STAGES] = {0, 0.2, 0.3, 0.8, 8.0 / 9, 1, 1};
static const double WEIGHT[STAGES][STAGES - 1] = {
    {0},
    {1.0 / 5},
    {3.0 / 40, 9.0 / 40},
    {44.0 / 45, -56.0 / 15, 32.0 / 9},
    {19372.0 / 6561, -25360.0 / 2187, 64448.0 / 6561, -212.0 / 729},
    {9017.0 / 3168, -355.0 / 33, 46732.0 / 5247, 49.0 / 176, -5103.0 / 18656},
    {35.0 / 384, 0, 500.0 / 1113, 125.0 / 192, -2187.0 / 6784, 11.0 / 84}};
static const double ERROR[STAGES] = {71.0 / 57600,      0,          -71.0 / 16695, 71.0 / 1920,
                                     -17253.0 / 339200, 22.0 / 525, -1.0 / 40};
static Row inverse[M];  // column j: what each vehicle takes of demand j

// Columns of the inverse of L, by Gauss and Jordan; L is 1 on the diagonal, so no row is exchanged.
static void invert(void) {
  double rows[M][2 * M] = {{0}};
  for (int i = 0; i < M; i++) {
    rows[i][i] = rows[i][M + i] = 1;
    rows[i][(i + M - 1) % M] = rows[i][(i + 1) % M] = -NEIGHBOUR;
  }
  for (int k = 0; k < M; k++) {
    double pivot = rows[k][k];
    for (int j = 0; j < 2 * M; j++) rows[k][j] /= pivot;
    for (int i = 0; i < M; i++) {
      double share = i == k ? 0 : rows[i][k];
      for (int j = 0; j < 2 * M; j++) rows[i][j] -= share * rows[k][j];
    }
  }
  for (int i = 0; i < M; i++)
    for (int j = 0; j < M; j++) inverse[j][i] = rows[i][M + j];
}

// The jerks that the law asks for, of one axis: L^-1 (received - L own), own being P(y) and the drift.
static inline void solve(const Row own, double received, Row jerk) {
  Row demand = {0};
  demand[0] = NAVIGATOR * received + NEIGHBOUR * (own[M - 1] + own[1]) - own[0];
  demand[M - 1] = NAVIGATOR * received + NEIGHBOUR * (own[M - 2] + own[0]) - own[M - 1];
  for (int i = 1; i < M - 1; i++)
    demand[i] = NAVIGATOR * received + NEIGHBOUR * (own[i - 1] + own[i + 1]) - own[i];
  memset(jerk, 0, sizeof(Row));
  for (int j = 0; j < M; j++)
#pragma omp simd
    for (int i = 0; i < PAD; i++) jerk[i] += inverse[j][i] * demand[j];
}

static inline void slopes(double t, State now, State slope) {
  Row cosine, sine, own[2], jerk[2];
  double *heading = now[2], *speed = now[3], *turn = now[4], *force = now[5];
  // Two loops: in one, both become a call of sincos, which takes one number at a time.
#pragma omp simd
  for (int i = 0; i < PAD; i++) cosine[i] = cos(heading[i]);
#pragma omp simd
  for (int i = 0; i < PAD; i++) sine[i] = sin(heading[i]);
#pragma omp simd
  for (int i = 0; i < PAD; i++) {
    double sideways = speed[i] * turn[i];
    double along = 3 * (speed[i] + force[i]) - sideways * turn[i], left = 3 * sideways + 2 * force[i] * turn[i];
    own[0][i] = now[0][i] + along * cosine[i] - left * sine[i];
    own[1][i] = now[1][i] + along * sine[i] + left * cosine[i];
  }
  for (int a = 0; a < 2; a++) {
    double w = FREQUENCY[a];
    solve(own[a], AMPLITUDE[a] * (sin(w * t) * (1 - 3 * w * w) + cos(w * t) * w * (3 - w * w)), jerk[a]);
  }
#pragma omp simd
  for (int i = 0; i < PAD; i++) {
    slope[0][i] = speed[i] * cosine[i], slope[1][i] = speed[i] * sine[i];
    slope[2][i] = turn[i], slope[3][i] = force[i];
    slope[4][i] = (cosine[i] * jerk[1][i] - sine[i] * jerk[0][i]) / speed[i];
    slope[5][i] = cosine[i] * jerk[0][i] + sine[i] * jerk[1][i];
  }
}

// The next state, and the mean square of its error over the tolerance.
static inline double step(double t, double h, State now, State slope[STAGES], State next) {
  for (int stage = 1; stage < STAGES; stage++) {
    for (int row = 0; row < 6; row++)
#pragma omp simd
      for (int i = 0; i < PAD; i++) {
        double sum = 0;
        for (int k = 0; k < stage; k++) sum += WEIGHT[stage][k] * slope[k][row][i];
        next[row][i] = now[row][i] + h * sum;
      }
    slopes(t + NODE[stage] * h, next, slope[stage]);
  }
  double square = 0;
  for (int row = 0; row < 6; row++)
#pragma omp simd reduction(+ : square)
    for (int i = 0; i < M; i++) {
      double sum = 0;
      for (int k = 0; k < STAGES; k++) sum += ERROR[k] * slope[k][row][i];
      double off = h * sum / (ATOL + RTOL * fmax(fabs(now[row][i]), fabs(next[row][i])));
      square += off * off;
    }
  return square / (6 * M);
}

// One lane from 0 to 30 s; its positions at output times.
static void simulate(const double *start, double *positions) {
  State now, next, slope[STAGES];
  double h = 1e-4;
  for (int row = 0; row < 6; row++)
    for (int i = 0; i < PAD; i++) now[row][i] = i < M ? start[row * M + i] : row == 3;
  slopes(0, now, slope[0]);
  for (int n = 0; n <= OUTPUTS; n++) {
    double t = (n - 1) * INTERVAL, end = n * INTERVAL;
    while (n && t < end) {
      int last = h >= end - t;
      double tried = last ? end - t : h, error = step(t, tried, now, slope, next);
      double wanted = tried * fmin(5, fmax(0.2, 0.9 * pow(fmax(error, 1e-20), -0.1)));
      if (error > 1) {
        h = wanted;
        continue;
      }
      t = last ? end : t + tried, h = last ? fmax(h, wanted) : wanted;
      memcpy(now, next, sizeof now), memcpy(slope[0], slope[STAGES - 1], sizeof now);
    }
    for (int i = 0; i < M; i++)
      for (int a = 0; a < 2; a++) positions[(n * M + i) * 2 + a] = now[a][i];
  }
}

static double uniform(double low, double high, unsigned long *seed) {
  *seed ^= *seed << 13, *seed ^= *seed >> 7, *seed ^= *seed << 17;
  return low + (high - low) * ((*seed >> 11) * (1.0 / 9007199254740992.0));
}

static void draw(double *start, unsigned long *seed) {
  for (int i = 0; i < M; i++) {
    start[i] = uniform(-200, 200, seed), start[M + i] = uniform(-200, 200, seed);
    start[2 * M + i] = uniform(-HALF_TURN, HALF_TURN, seed), start[3 * M + i] = uniform(0.2, 0.4, seed);
    start[4 * M + i] = start[5 * M + i] = 0;
  }
}

int main(int count, char **given) {
  if (count != 2 && count != 4) return fprintf(stderr, "usage: nonlinear_loop LANES [STARTS POSITIONS]\n"), 2;
  size_t lanes = atol(given[1]), each = (OUTPUTS + 1) * M * 2, kept = count == 4 ? lanes : (size_t)omp_get_max_threads();
  double *starts = malloc(lanes * 6 * M * sizeof(double)), *found = malloc(kept * each * sizeof(double));
  unsigned long seed = 88172645463325252UL;
  FILE *file = count == 4 ? fopen(given[2], "rb") : NULL;
  if (count == 4 && (!file || fread(starts, 6 * M * sizeof(double), lanes, file) != lanes)) return perror(given[2]), 1;
  for (size_t n = 0; count == 2 && n < lanes; n++) draw(starts + n * 6 * M, &seed);
  invert();
  double begun = omp_get_wtime();
#pragma omp parallel for schedule(dynamic, 4)
  for (size_t n = 0; n < lanes; n++)
    simulate(starts + n * 6 * M, found + (count == 4 ? n : (size_t)omp_get_thread_num()) * each);
  printf("%.1f\n", lanes / (omp_get_wtime() - begun));
  file = count == 4 ? fopen(given[3], "wb") : NULL;
  if (count == 4 && (!file || fwrite(found, each * sizeof(double), lanes, file) != lanes)) return perror(given[3]), 1;
}
