// The explicit step in plain C++, one thread: springs scatter their forces, then particles move.
// The law is that of the benchmark of Warp's own cloth: stiffness in N/m, damping in N s/m.

#include <cmath>

struct Spring {
    int a, b;
    float rest, stiffness, damping;
};

extern "C" void steps(int particles, int springs, int count, float dt, const float* gravity, const Spring* spring,
                      const float* inverse_mass, float* x, float* v, float* f) {
    for (int step = 0; step < count; ++step) {
        for (int i = 0; i < 3 * particles; ++i) f[i] = 0.0f;
        for (int k = 0; k < springs; ++k) {
            const Spring s = spring[k];
            const float *xa = x + 3 * s.a, *xb = x + 3 * s.b, *va = v + 3 * s.a, *vb = v + 3 * s.b;
            const float dx = xb[0] - xa[0], dy = xb[1] - xa[1], dz = xb[2] - xa[2];
            const float length = std::sqrt(dx * dx + dy * dy + dz * dz);
            const float over = 1.0f / length;
            const float rate = (dx * (vb[0] - va[0]) + dy * (vb[1] - va[1]) + dz * (vb[2] - va[2])) * over;
            const float pull = (s.stiffness * (length - s.rest) + s.damping * rate) * over;
            float *fa = f + 3 * s.a, *fb = f + 3 * s.b;
            fa[0] += pull * dx;
            fa[1] += pull * dy;
            fa[2] += pull * dz;
            fb[0] -= pull * dx;
            fb[1] -= pull * dy;
            fb[2] -= pull * dz;
        }
        for (int i = 0; i < particles; ++i) {
            if (inverse_mass[i] == 0.0f) continue;
            for (int c = 0; c < 3; ++c) {
                v[3 * i + c] += dt * (gravity[c] + inverse_mass[i] * f[3 * i + c]);
                x[3 * i + c] += dt * v[3 * i + c];
            }
        }
    }
}
