// The TC monolithic step, eq. (A1) of Romero (2009), written by hand for the double thermoelastic pendulum: the bound
// that compare_limits.py measures tcbench's generated code against. Newton on (q1, q2, s_a, s_b) with the exact
// Jacobian and partial pivoting, from the drift q0 + h p0/m; p is eliminated by q1 - q0 = h (p0 + p1)/(2m).
//
// usage: tc_step H STEPS REPEATS  m1 m2 C_a C_b l_a l_b kappa theta_ref beta c0  z0[0] ... z0[9]
// prints: seconds per step (best repeat), Newton iterations per step, relative energy change, final q2
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <utility>

namespace {
constexpr int N = 6;
double m[2], C[2], l0[2], kappa, theta_ref, beta, c0;
long iterations = 0;

// divided differences of exp and log, (27)-(33), and their derivatives
inline double phi(double x) { return std::fabs(x) < 1e-9 ? 1 + x / 2 : std::expm1(x) / x; }
inline double dphi(double x, double f) {
  if (std::fabs(x) < 1e-3) return 0.5 + x * (1. / 3 + x * (0.125 + x / 30));
  return (1 + x * f - f) / x;
}
inline double lam(double x) { return std::fabs(x) < 1e-9 ? 1 - x / 2 : std::log1p(x) / x; }
inline double dlam(double x, double f) {
  if (std::fabs(x) < 1e-3) return -0.5 + x * (2. / 3 - x * (0.75 - 0.8 * x));
  return (1 / (1 + x) - f) / x;
}

struct Start { double pi, s, L, E; };                    // of a spring at z0; E = exp((s - beta L)/c0)
struct Slopes { double stress, stress_pi, stress_s, theta, theta_pi, theta_s; };

inline Start start(int i, double x, double y, double s) {
  double pi = x * x + y * y, L = 0.5 * std::log(pi / (l0[i] * l0[i]));
  return {pi, s, L, std::exp((s - beta * L) / c0)};
}

inline Slopes slopes(int i, const Start& a, double pi1, double s1) {
  double x = (pi1 - a.pi) / a.pi, f = lam(x);
  double A = 0.5 * f / a.pi, A_pi = 0.5 * dlam(x, f) / (a.pi * a.pi);   // dL/dpi as a quotient
  double dL = A * (pi1 - a.pi), dL_pi = 0.5 / pi1;
  double u = -beta * dL / c0, g = phi(u), g_pi = dphi(u, g) * (-beta / c0) * dL_pi;
  double w = (s1 - a.s) / c0, k = phi(w), k_s = dphi(w, k) / c0;
  double e_s = a.E * (1 + w * k), sum = a.E + e_s, sum_s = e_s / c0;
  double e_pi = a.E * (1 + u * g), e_pi_pi = e_pi * (-beta / c0) * dL_pi;
  double B = 0.5 * C[i] * (2 * a.L + dL) + beta * theta_ref * (1 - 0.5 * sum * g);
  Slopes o;
  o.stress = A * B;
  o.stress_pi = A_pi * B + A * (0.5 * C[i] * dL_pi - 0.5 * beta * theta_ref * sum * g_pi);
  o.stress_s = -0.5 * A * beta * theta_ref * sum_s * g;
  o.theta = 0.5 * theta_ref * (e_pi + a.E) * k;
  o.theta_pi = 0.5 * theta_ref * e_pi_pi * k;
  o.theta_s = 0.5 * theta_ref * (e_pi + a.E) * k_s;
  return o;
}

inline void solve(double A[N][N + 1]) {
  for (int k = 0; k < N; k++) {
    int pivot = k;
    for (int i = k + 1; i < N; i++)
      if (std::fabs(A[i][k]) > std::fabs(A[pivot][k])) pivot = i;
    if (pivot != k)
      for (int j = k; j <= N; j++) std::swap(A[k][j], A[pivot][j]);
    double inverse = 1 / A[k][k];
    for (int i = k + 1; i < N; i++) {
      double factor = A[i][k] * inverse;
      for (int j = k + 1; j <= N; j++) A[i][j] -= factor * A[k][j];
    }
  }
  for (int k = N - 1; k >= 0; k--) {
    for (int j = k + 1; j < N; j++) A[k][N] -= A[k][j] * A[j][N];
    A[k][N] /= A[k][k];
  }
}

bool step(double* z, double h) {
  const double ax = z[0], ay = z[1], bx = z[2] - z[0], by = z[3] - z[1];
  const Start a = start(0, ax, ay, z[8]), b = start(1, bx, by, z[9]);
  double X[N];
  for (int i = 0; i < 4; i++) X[i] = z[i] + h * z[4 + i] / m[i / 2];
  X[4] = z[8];
  X[5] = z[9];
  double previous = INFINITY;
  for (int iteration = 0; iteration < 50; iteration++) {
    iterations++;
    const double qx = X[0], qy = X[1], rx = X[2] - X[0], ry = X[3] - X[1];
    const Slopes A_ = slopes(0, a, qx * qx + qy * qy, X[4]), B_ = slopes(1, b, rx * rx + ry * ry, X[5]);
    const double hx = ax + qx, hy = ay + qy, gx = bx + rx, gy = by + ry;   // twice the midpoint springs
    const double k1 = 2 * m[0] / h, k2 = 2 * m[1] / h;
    // stiffness of each spring: d(force)/d(its end)
    const double sa[4] = {h * (A_.stress + 2 * hx * A_.stress_pi * qx), h * 2 * hx * A_.stress_pi * qy,
                          h * 2 * hy * A_.stress_pi * qx, h * (A_.stress + 2 * hy * A_.stress_pi * qy)};
    const double sb[4] = {h * (B_.stress + 2 * gx * B_.stress_pi * rx), h * 2 * gx * B_.stress_pi * ry,
                          h * 2 * gy * B_.stress_pi * rx, h * (B_.stress + 2 * gy * B_.stress_pi * ry)};
    const double ca[2] = {h * hx * A_.stress_s, h * hy * A_.stress_s}, cb[2] = {h * gx * B_.stress_s, h * gy * B_.stress_s};
    double M[N][N + 1] = {
        {k1 + sa[0] + sb[0], sa[1] + sb[1], -sb[0], -sb[1], ca[0], -cb[0],
         -(k1 * (qx - ax) - 2 * z[4] + h * (A_.stress * hx - B_.stress * gx))},
        {sa[2] + sb[2], k1 + sa[3] + sb[3], -sb[2], -sb[3], ca[1], -cb[1],
         -(k1 * (qy - ay) - 2 * z[5] + h * (A_.stress * hy - B_.stress * gy))},
        {-sb[0], -sb[1], k2 + sb[0], sb[1], 0, cb[0], -(k2 * (X[2] - z[2]) - 2 * z[6] + h * B_.stress * gx)},
        {-sb[2], -sb[3], sb[2], k2 + sb[3], 0, cb[1], -(k2 * (X[3] - z[3]) - 2 * z[7] + h * B_.stress * gy)},
        {}, {}};
    const double ta = A_.theta, tb = B_.theta, hk = h * kappa;
    const double ga = hk * (tb - ta) / ta, gb = hk * (ta - tb) / tb;
    const double ga_a = -hk * tb / (ta * ta), ga_b = hk / ta, gb_b = -hk * ta / (tb * tb), gb_a = hk / tb;
    const double qa[4] = {2 * A_.theta_pi * qx, 2 * A_.theta_pi * qy, 0, 0};
    const double qb[4] = {-2 * B_.theta_pi * rx, -2 * B_.theta_pi * ry, 2 * B_.theta_pi * rx, 2 * B_.theta_pi * ry};
    for (int j = 0; j < 4; j++) {
      M[4][j] = -(ga_a * qa[j] + ga_b * qb[j]);
      M[5][j] = -(gb_a * qa[j] + gb_b * qb[j]);
    }
    M[4][4] = 1 - ga_a * A_.theta_s; M[4][5] = -ga_b * B_.theta_s; M[4][6] = -(X[4] - z[8] - ga);
    M[5][4] = -gb_a * A_.theta_s; M[5][5] = 1 - gb_b * B_.theta_s; M[5][6] = -(X[5] - z[9] - gb);
    solve(M);
    double size = 0;
    for (int i = 0; i < N; i++) {
      X[i] += M[i][N];
      double relative = std::fabs(M[i][N]) / (1 + std::fabs(X[i]));
      if (!(relative <= size)) size = relative;
    }
    if (!(size < 1e100)) return false;
    if (size < 1e-14 || (size < 1e-12 && size >= previous)) {
      for (int i = 0; i < 4; i++) {
        z[4 + i] = 2 * m[i / 2] / h * (X[i] - z[i]) - z[4 + i];
        z[i] = X[i];
      }
      z[8] = X[4];
      z[9] = X[5];
      return true;
    }
    previous = size;
  }
  return false;
}

double energy(const double* z) {
  double E = 0;
  for (int i = 0; i < 4; i++) E += z[4 + i] * z[4 + i] / (2 * m[i / 2]);
  for (int i = 0; i < 2; i++) {
    double x = z[2 * i] - (i ? z[0] : 0), y = z[2 * i + 1] - (i ? z[1] : 0);
    Start e = start(i, x, y, z[8 + i]);
    E += C[i] / 2 * e.L * e.L + beta * theta_ref * e.L + c0 * theta_ref * (e.E - 1);
  }
  return E;
}
}  // namespace

int main(int argc, char** argv) {
  if (argc != 24) return 2;
  double v[23];
  for (int i = 1; i < 24; i++) v[i - 1] = std::atof(argv[i]);
  const double h = v[0];
  const long steps = static_cast<long>(v[1]);
  for (int i = 0; i < 2; i++) { m[i] = v[3 + i]; C[i] = v[5 + i]; l0[i] = v[7 + i]; }
  kappa = v[9]; theta_ref = v[10]; beta = v[11]; c0 = v[12];
  double best = INFINITY, z[10], E0 = energy(v + 13);
  for (int r = 0; r < static_cast<int>(v[2]); r++) {
    std::memcpy(z, v + 13, sizeof z);
    iterations = 0;
    auto begin = std::chrono::steady_clock::now();
    for (long k = 0; k < steps; k++)
      if (!step(z, h)) { std::printf("failed at step %ld\n", k + 1); return 1; }
    double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    if (seconds < best) best = seconds;
  }
  std::printf("%.6e %.3f %.3e %.17g %.17g\n", best / steps, double(iterations) / steps, (energy(z) - E0) / E0, z[2], z[3]);
  return 0;
}
