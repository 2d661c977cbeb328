// The exact closed loop of the paper's ring by hand, eight lanes to a vector: what the machine can do.
//
// Twelve vehicles, gain (1, 3, 3), a navigator weight of 0.1, a rotating attack of 5 m and 0.7 rad/s on 2, 5, 8 and
// 11, outputs every 0.1 s of 30 s, the metrics of a row; untrimmed, or trimming with theta = 1 each 0.05 s.
// Its lanes are drawn from the distributions of jaxnet's default study, by a generator of its own.
//
// gcc -O3 -march=native -ffast-math -fopenmp -Wno-psabi exact_loop.c -o exact_loop -lm
// ./exact_loop LANES TRIMS(0|1) prints lanes per second, the mean tail error [m] and the share of lanes over 0.1 m.
#include <math.h>
#include <omp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define M 12
#define WIDTH 8
#define TURN 6.283185307179586
typedef double Vec __attribute__((vector_size(8 * WIDTH)));
typedef long Mask __attribute__((vector_size(8 * WIDTH)));

static const double OMEGA = 0.7, TICK = 0.05, MAGNITUDE = 5, NAVIGATOR = 0.1, NEIGHBOUR = 0.45, STICK = 1e-9;
static double flow[3][3];  // expm(A_c h), a triple pole at -1
static int trims;

static inline Vec choose(Mask mask, Vec a, Vec b) { return (Vec)(((Mask)a & mask) | ((Mask)b & ~mask)); }
static inline Vec greater(Vec a, Vec b) { return choose(a > b, a, b); }
static inline Vec less(Vec a, Vec b) { return choose(a < b, a, b); }
static inline Vec root(Vec a) {
  Vec found;
  for (int k = 0; k < WIDTH; k++) found[k] = sqrt(a[k]);
  return found;
}
static inline int left(int i) { return (i + M - 1) % M; }
static inline int right(int i) { return (i + 1) % M; }
static inline int attacked(int i) { return i % 3 == 1; }
static double uniform(unsigned long *seed) {
  *seed ^= *seed << 13, *seed ^= *seed >> 7, *seed ^= *seed << 17;
  return (*seed >> 11) * (1.0 / 9007199254740992.0);
}

// L^-1 W times the four columns of an attack (cosine x, y, sine x, y) of one lane; dropped: 0 left, 1 right.
static void forced(const int dropped[M], const double attack[4][M], double found[4][M]) {
  double rows[M][M + 4];
  memset(rows, 0, sizeof rows);
  for (int i = 0; i < M; i++) {
    double of_left = dropped[i] == 0 ? 0 : NEIGHBOUR, of_right = dropped[i] == 1 ? 0 : NEIGHBOUR;
    double total = of_left + of_right + NAVIGATOR;
    of_left /= total, of_right /= total;
    rows[i][i] += 1, rows[i][left(i)] -= of_left, rows[i][right(i)] -= of_right;
    for (int b = 0; b < 4; b++) rows[i][M + b] = of_left * attack[b][left(i)] + of_right * attack[b][right(i)];
  }
  for (int k = 0; k < M; k++)
    for (int i = k + 1; i < M; i++) {
      double share = rows[i][k] / rows[k][k];
      if (share != 0)
        for (int j = k; j < M + 4; j++) rows[i][j] -= share * rows[k][j];
    }
  for (int k = M - 1; k >= 0; k--)
    for (int b = 0; b < 4; b++) {
      double rest = rows[k][M + b];
      for (int j = k + 1; j < M; j++) rest -= rows[k][j] * found[b][j];
      found[b][k] = rest / rows[k][k];
    }
}

// Eight lanes from 0 to 30 s: the sum of their mean tail errors; `over` counts those over 0.1 m.
static double group(unsigned long seed, double *over) {
  Vec free[3][2][M], cosine[2][M], sine[2][M], says_cosine[2][M], says_sine[2][M], dropped[M];
  Vec tail = (Vec){0}, worst = (Vec){0}, peak = (Vec){0}, slowest = (Vec){0} + 1e9, turn = (Vec){0}, apart = (Vec){0};
  memset(cosine, 0, sizeof cosine), memset(sine, 0, sizeof sine);
  memset(says_cosine, 0, sizeof says_cosine), memset(says_sine, 0, sizeof says_sine);
  for (int i = 0; i < M; i++) dropped[i] = (Vec){0} - 2;
  for (int k = 0; k < WIDTH; k++)
    for (int i = 0; i < M; i++) {
      double x = 400 * uniform(&seed) - 200, y = 400 * uniform(&seed) - 200, heading = TURN * uniform(&seed);
      double speed = 0.2 + 0.2 * uniform(&seed), phase = TURN * uniform(&seed);
      free[0][0][i][k] = x, free[0][1][i][k] = y, free[2][0][i][k] = 0, free[2][1][i][k] = 0;
      free[1][0][i][k] = speed * cos(heading) - 20, free[1][1][i][k] = speed * sin(heading) - 20;
      if (!attacked(i)) continue;
      says_cosine[0][i][k] = MAGNITUDE * cos(phase), says_cosine[1][i][k] = MAGNITUDE * sin(phase);
      says_sine[0][i][k] = -MAGNITUDE * sin(phase), says_sine[1][i][k] = MAGNITUDE * cos(phase);
    }
  for (int n = 0; n <= 600; n++) {
    double t = n * TICK, c = cos(OMEGA * t), s = sin(OMEGA * t);
    Vec error[2][M], heard[M], drops[M];
    Mask changed = (Mask){0};
    for (int a = 0; a < 2; a++)
      for (int i = 0; i < M; i++) error[a][i] = free[0][a][i] + c * cosine[a][i] + s * sine[a][i];
    if (trims) {
      for (int i = 0; i < M; i++) {
        Vec x = error[0][i], y = error[1][i];
        if (attacked(i)) {
          x += c * says_cosine[0][i] + s * says_sine[0][i];
          y += c * says_cosine[1][i] + s * says_sine[1][i];
        }
        heard[i] = root(x * x + y * y);
      }
      for (int i = 0; i < M; i++) {
        Vec of_left = heard[left(i)] + choose(dropped[i] == 0.0, (Vec){0} + STICK, (Vec){0});
        Vec of_right = heard[right(i)] + choose(dropped[i] == 1.0, (Vec){0} + STICK, (Vec){0});
        drops[i] = choose(of_left >= of_right, (Vec){0}, (Vec){0} + 1.0);
        changed |= (drops[i] != dropped[i]);
      }
    } else if (n == 0) {
      for (int i = 0; i < M; i++) drops[i] = (Vec){0} - 1;
      changed = ~(Mask){0};
    }
    for (int k = 0; k < WIDTH; k++) {
      if (!changed[k]) continue;
      int whom[M];
      double attack[4][M], response[4][M];
      for (int i = 0; i < M; i++) {
        whom[i] = (int)drops[i][k];
        for (int a = 0; a < 2; a++) attack[a][i] = says_cosine[a][i][k], attack[2 + a][i] = says_sine[a][i][k];
      }
      forced(whom, attack, response);
      for (int i = 0; i < M; i++) {
        dropped[i][k] = drops[i][k];
        for (int a = 0; a < 2; a++) {
          double x = cosine[a][i][k] - response[a][i], y = sine[a][i][k] - response[2 + a][i];
          free[0][a][i][k] += c * x + s * y;
          free[1][a][i][k] += OMEGA * (c * y - s * x);
          free[2][a][i][k] -= OMEGA * OMEGA * (c * x + s * y);
          cosine[a][i][k] = response[a][i], sine[a][i][k] = response[2 + a][i];
        }
      }
    }
    if (n % 2 == 0) {
      double velocity[2] = {20 * cos(0.2 * t), 20 * cos(0.4 * t)};
      double acceleration[2] = {-4 * sin(0.2 * t), -8 * sin(0.4 * t)};
      for (int i = 0; i < M; i++) {
        Vec off = root(error[0][i] * error[0][i] + error[1][i] * error[1][i]), v[2], w[2];
        for (int a = 0; a < 2; a++) {
          v[a] = free[1][a][i] + OMEGA * (c * sine[a][i] - s * cosine[a][i]) + velocity[a];
          w[a] = free[2][a][i] - OMEGA * OMEGA * (c * cosine[a][i] + s * sine[a][i]) + acceleration[a];
        }
        Vec square = v[0] * v[0] + v[1] * v[1], rate = (v[0] * w[1] - v[1] * w[0]) / square;
        peak = greater(peak, off), slowest = less(slowest, square), turn = greater(turn, rate * rate);
        if (n < 500) continue;
        tail += off, worst = greater(worst, off);
        Vec of_left = choose(dropped[i] == 0.0, (Vec){0}, (Vec){0} + NEIGHBOUR);
        Vec of_right = choose(dropped[i] == 1.0, (Vec){0}, (Vec){0} + NEIGHBOUR);
        Vec total = 1 / (of_left + of_right + NAVIGATOR);
        Vec x = error[0][i] - total * (of_left * error[0][left(i)] + of_right * error[0][right(i)]);
        Vec y = error[1][i] - total * (of_left * error[1][left(i)] + of_right * error[1][right(i)]);
        apart += root(x * x + y * y);
      }
    }
    for (int a = 0; a < 2; a++)
      for (int i = 0; i < M; i++) {
        Vec e = free[0][a][i], v = free[1][a][i], w = free[2][a][i];
        for (int k = 0; k < 3; k++) free[k][a][i] = flow[k][0] * e + flow[k][1] * v + flow[k][2] * w;
      }
  }
  double sum = 0;  // every metric enters it, so that none is optimised away
  for (int k = 0; k < WIDTH; k++) {
    double mean = tail[k] / (M * 51);
    sum += mean + 1e-12 * (worst[k] + peak[k] + slowest[k] + turn[k] + apart[k]);
    *over += mean > 0.1;
  }
  return sum;
}

int main(int count, char **given) {
  if (count != 3) return fprintf(stderr, "usage: exact_loop LANES TRIMS(0|1)\n"), 2;
  long lanes = atol(given[1]);
  double h = TICK, decay = exp(-h), total = 0, over = 0;
  trims = atoi(given[2]);
  double rows[3][3] = {{1 + h + h * h / 2, h + h * h, h * h / 2},
                       {-h * h / 2, 1 + h - h * h, h - h * h / 2},
                       {-h + h * h / 2, -3 * h + h * h, 1 - 2 * h + h * h / 2}};
  for (int k = 0; k < 9; k++) flow[k / 3][k % 3] = decay * rows[k / 3][k % 3];
  double begun = omp_get_wtime();
#pragma omp parallel for schedule(dynamic, 16) reduction(+ : total, over)
  for (long number = 0; number < lanes / WIDTH; number++) {
    double some = 0;
    total += group(88172645463325252UL + number * 2654435761UL, &some);
    over += some;
  }
  printf("%.1f %.6g %.6g\n", lanes / (omp_get_wtime() - begun), total / lanes, over / lanes);
}
