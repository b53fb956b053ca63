"""Eight numbers at once, for the CPU: C++ that ``wp.func_native`` snippets begin with.

Warp's own code treats one particle after the other; processors work on four to sixteen numbers in one instruction, if
these lie side by side. Clang's vectors become the instructions of whatever processor compiles them. On GPUs, whose
threads are lanes already, snippets of this kind are empty: wrap them in :func:`for_cpu`.

    V             a vector of :data:`LANES` numbers R, of the variant's precision; ``a < b`` gives a mask
    load, store   at any address
    only          what a mask lets through, 0 elsewhere
    among         the mask of lanes whose bit is set
    root          square root of each
    some          the first ``count`` of eight numbers, the rest 0
    some3, put3   the first ``count`` of eight triples side by side, as a V3, the rest 0; and back
    each          eight numbers as triples of the same number
    unpack, pack  triples side by side (x y z x y z …) as three rows of n numbers, filled with zeros to the next
                  multiple of eight, and back
"""

from .precision import real

LANES = 8

_EVERY_THIRD = [", ".join(str(3 * k + axis) for k in range(LANES)) for axis in range(3)]
_EACH = ", ".join(str(k // 3) for k in range(3 * LANES))
_BITS = ", ".join(str(1 << k) for k in range(LANES))
_XY = ", ".join(str(k) for k in range(2 * LANES))
_Z = ", ".join([str(k) for k in range(LANES)] + ["-1"] * LANES)
_XYZ = ", ".join(f"{k}, {LANES + k}, {2 * LANES + k}" for k in range(LANES))

_LANES_CPP = f"""
    typedef {"double" if real.__name__ == "float64" else "float"} R;
    typedef R V __attribute__((ext_vector_type({LANES})));
    typedef R V2 __attribute__((ext_vector_type({2 * LANES})));
    typedef R V3 __attribute__((ext_vector_type({3 * LANES})));
    typedef decltype(V() < V()) Mask;
    auto load = [](const R* from) {{ V v; __builtin_memcpy(&v, from, sizeof(V)); return v; }};
    auto store = [](R* to, V v) {{ __builtin_memcpy(to, &v, sizeof(V)); }};
    auto only = [](V v, Mask mask) {{ return (V)((Mask)v & mask); }};
    auto among = [](int bits) {{ return (Mask{{{_BITS}}} & bits) != 0; }};
    auto root = [](V v) {{ return __builtin_elementwise_sqrt(v); }};
    auto some = [](const R* from, int count) {{
        V v = 0;
        if (count >= {LANES}) __builtin_memcpy(&v, from, sizeof(V));
        else __builtin_memcpy(&v, from, count * sizeof(R));
        return v;
    }};
    auto some3 = [](const R* from, int count) {{
        V3 v = 0;
        if (count >= {LANES}) __builtin_memcpy(&v, from, 3 * {LANES} * sizeof(R));
        else __builtin_memcpy(&v, from, 3 * count * sizeof(R));
        return v;
    }};
    auto put3 = [](R* to, V3 v, int count) {{
        if (count >= {LANES}) __builtin_memcpy(to, &v, 3 * {LANES} * sizeof(R));
        else __builtin_memcpy(to, &v, 3 * count * sizeof(R));
    }};
    auto each = [](V v) {{ return (V3)__builtin_shufflevector(v, v, {_EACH}); }};
    auto unpack = [&](const R* from, int n, R* x, R* y, R* z) {{
        int i = 0;
        for (; i + {LANES} <= n; i += {LANES}) {{
            V3 v;
            __builtin_memcpy(&v, from + 3 * i, sizeof(R) * {3 * LANES});
            store(x + i, __builtin_shufflevector(v, v, {_EVERY_THIRD[0]}));
            store(y + i, __builtin_shufflevector(v, v, {_EVERY_THIRD[1]}));
            store(z + i, __builtin_shufflevector(v, v, {_EVERY_THIRD[2]}));
        }}
        for (; i < n; ++i) {{ x[i] = from[3 * i]; y[i] = from[3 * i + 1]; z[i] = from[3 * i + 2]; }}
        for (; i % {LANES}; ++i) x[i] = y[i] = z[i] = 0;
    }};
    auto pack = [&](R* to, int n, const R* x, const R* y, const R* z) {{
        int i = 0;
        for (; i + {LANES} <= n; i += {LANES}) {{
            const V2 xy = __builtin_shufflevector(load(x + i), load(y + i), {_XY});
            const V2 z_ = __builtin_shufflevector(load(z + i), load(z + i), {_Z});
            const V3 v = __builtin_shufflevector(xy, z_, {_XYZ});
            __builtin_memcpy(to + 3 * i, &v, sizeof(R) * {3 * LANES});
        }}
        for (; i < n; ++i) {{ to[3 * i] = x[i]; to[3 * i + 1] = y[i]; to[3 * i + 2] = z[i]; }}
    }};
"""


# rest, k_s, k_d: r, k_s/r and k_d/r of the springs of entry e, as arrange_lanes of kernels/springs.py has them.
LAW = f"""
            V rest, k_s, k_d;
            if (const int by = shared_by.data[e]; by >= 0) {{
                const R* of_law = (const R*)(shared_law.data + e);
                rest = only((V)of_law[0], among(by));
                k_s = of_law[1];
                k_d = of_law[2];
            }} else {{
                const R* of_law = law.data + {3 * LANES} * (long long)e;
                rest = load(of_law);
                k_s = load(of_law + {LANES});
                k_d = load(of_law + {2 * LANES});
            }}
"""


def for_cpu(code: str) -> str:
    """A snippet of what is above and ``code``; nothing for GPUs."""
    return f"\n#if !defined(__CUDA_ARCH__)\n{_LANES_CPP}{code}\n#endif\n"
