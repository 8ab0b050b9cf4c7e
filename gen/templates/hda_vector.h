/* Vectors of HDA_W doubles and the elementary functions over them; included once for each width, with HDA_W and HDA_V
 * defined.
 *
 * Legend: n multiple of the period, r reduced argument. Sources: reduction by parts (Cody, Waite, Software Manual for
 * the Elementary Functions, 1980), polynomials through Chebyshev's points of the reduced interval. exp, sin, cos, tan,
 * atan err by a few units in the last place, tanh by 3e-16 absolute. Functions take pointers and are inlined: no vector
 * crosses a call.
 */
#if defined(__SSE2__)
#include <immintrin.h>
#endif

#define HDA_GLUE_(a, b) a##b
#define HDA_GLUE(a, b) HDA_GLUE_(a, b)
#define HDA_I HDA_GLUE(HDA_V, _bits)
#define HDA_FUNCTION(name) static inline __attribute__((always_inline, unused)) void HDA_GLUE(HDA_GLUE(HDA_V, _), name)

typedef double HDA_V __attribute__((vector_size(8 * HDA_W)));
typedef long long HDA_I __attribute__((vector_size(8 * HDA_W)));
/* over plain doubles */
typedef double HDA_GLUE(HDA_V, _loose) __attribute__((vector_size(8 * HDA_W), aligned(8), may_alias));

#define HDA_BITS(a) ((HDA_I)(a))
#define HDA_PICK(mask, a, b) ((HDA_V)(((mask) & HDA_BITS(a)) | (~(mask) & HDA_BITS(b))))
#define HDA_ZERO ((HDA_V){0})

/* One instruction each where the compiler would not find it. */
#if HDA_W == 8 && defined(__AVX512F__)
#define HDA_LESSER(a, b) ((HDA_V)_mm512_min_pd(a, b))
#define HDA_GREATER(a, b) ((HDA_V)_mm512_max_pd(a, b))
#define HDA_IF_ODD(n, a, b) \
    ((HDA_V)_mm512_mask_blend_pd(_mm512_test_epi64_mask((__m512i)(n), _mm512_set1_epi64(1)), b, a))
#define HDA_BELOW(a) ((HDA_V)_mm512_roundscale_pd(a, _MM_FROUND_TO_NEG_INF))
#elif HDA_W == 4 && defined(__AVX__)
#define HDA_LESSER(a, b) ((HDA_V)_mm256_min_pd(a, b))
#define HDA_GREATER(a, b) ((HDA_V)_mm256_max_pd(a, b))
#define HDA_BELOW(a) ((HDA_V)_mm256_floor_pd(a))
#elif HDA_W == 2 && defined(__SSE2__)
#define HDA_LESSER(a, b) ((HDA_V)_mm_min_pd(a, b))
#define HDA_GREATER(a, b) ((HDA_V)_mm_max_pd(a, b))
#else
#define HDA_LESSER(a, b) HDA_PICK((a) < (b), a, b)
#define HDA_GREATER(a, b) HDA_PICK((a) > (b), a, b)
#endif
#ifndef HDA_IF_ODD
#define HDA_IF_ODD(n, a, b) HDA_PICK(((n) & 1) == 0, b, a)
#endif

HDA_FUNCTION(fabs)(const HDA_V *a, HDA_V *r) {
    *r = (HDA_V)(HDA_BITS(*a) & ~HDA_BITS(-HDA_ZERO));
}

HDA_FUNCTION(sign)(const HDA_V *a, HDA_V *r) {
    const HDA_V one = 1.0 - HDA_ZERO;
    const HDA_V signed_one = (HDA_V)(HDA_BITS(one) | (HDA_BITS(*a) & HDA_BITS(-HDA_ZERO)));
    *r = HDA_PICK((*a < HDA_ZERO) | (*a > HDA_ZERO), signed_one, *a);
}

/* Where the first is NaN the second is the result, as in C; a second that is NaN stays NaN, so that one comparison
 * does. */
HDA_FUNCTION(fmin)(const HDA_V *a, const HDA_V *b, HDA_V *r) {
    *r = HDA_LESSER(*a, *b);
}
HDA_FUNCTION(fmax)(const HDA_V *a, const HDA_V *b, HDA_V *r) {
    *r = HDA_GREATER(*a, *b);
}

HDA_FUNCTION(floor)(const HDA_V *a, HDA_V *r) {
#ifdef HDA_BELOW
    *r = HDA_BELOW(*a);
#else
    for (int i = 0; i < HDA_W; i++) (*r)[i] = floor((*a)[i]);
#endif
}

HDA_FUNCTION(exp)(const HDA_V *a, HDA_V *r) {
    const HDA_V magic = 6755399441055744.0 - HDA_ZERO; /* 1.5 · 2^52: adding it rounds to an integer in the low bits */
    const HDA_V x = HDA_PICK(*a < -708.0, -708.0 - HDA_ZERO, *a);
    const HDA_V shifted = x * 1.4426950408889634 + magic;
    const HDA_V n = shifted - magic;
    const HDA_V s = (x - n * 6.93145751953125e-1) - n * 1.42860682030941723212e-6;
    const HDA_V s2 = s * s, s4 = s2 * s2;
    const HDA_V low = (1.0 + s) + s2 * (0.5000000000000001 + s * 0.16666666666666669);
    const HDA_V mid =
        (0.04166666666662413 + s * 0.008333333333330062) + s2 * (0.0013888888917213717 + s * 0.00019841269863053618);
    const HDA_V top = (2.4801521295954376e-05 + s * 2.7557268459997064e-06) +
                      s2 * (2.7620088445409746e-07 + s * 2.510038549551032e-08);
    const HDA_V value = low + s4 * (mid + s4 * top);
    const HDA_V scaled = (HDA_V)(HDA_BITS(value) + (HDA_BITS(shifted) << 52));
    const HDA_V huge = HDA_PICK(*a > 709.0, INFINITY - HDA_ZERO, scaled);
    *r = HDA_PICK(*a == *a, HDA_PICK(*a < -708.0, HDA_ZERO, huge), *a);
}

/* Sine and cosine of the argument reduced to [−π/4, π/4], and the quadrant. Beyond 2^40 the argument has no angle left:
 * NaN. */
HDA_FUNCTION(sincos)(const HDA_V *a, HDA_V *sine, HDA_V *cosine) {
    const HDA_V magic = 6755399441055744.0 - HDA_ZERO;
    const HDA_V shifted = *a * 6.36619772367581382433e-1 + magic;
    const HDA_V n = shifted - magic;
    const HDA_V far = *a * 1.6349e296; /* infinite beyond 2^40 */
    const HDA_V lost = far - far;
    const HDA_V z = (*a - n * 1.57079632673412561417e+00) - (n * 6.07710050650619224932e-11 + lost);
    const HDA_V z2 = z * z, z4 = z2 * z2;
    const HDA_V s_low = -0.16666666666666666 + z2 * 0.008333333333330949;
    const HDA_V s_mid = -0.0001984126983675497 + z2 * 2.755731610068303e-06;
    const HDA_V s_top = -2.5051131455427946e-08 + z2 * 1.591810123027412e-10;
    const HDA_V s = z + z * z2 * (s_low + z4 * (s_mid + z4 * s_top));
    const HDA_V c_low = 0.041666666666666664 + z2 * -0.0013888888888887395;
    const HDA_V c_mid = 2.4801587298763433e-05 + z2 * -2.7557317270560326e-07;
    const HDA_V c_top = 2.0876146024689747e-09 + z2 * -1.1382614868556325e-11;
    const HDA_V c = (1.0 - 0.5 * z2) + z4 * (c_low + z4 * (c_mid + z4 * c_top));
    const HDA_I quadrant = HDA_BITS(shifted), sign = HDA_BITS(-HDA_ZERO);
    *sine = (HDA_V)(HDA_BITS(HDA_IF_ODD(quadrant, c, s)) ^ ((quadrant << 62) & sign));
    *cosine = (HDA_V)(HDA_BITS(HDA_IF_ODD(quadrant, s, c)) ^ (((quadrant + 1) << 62) & sign));
}

HDA_FUNCTION(sin)(const HDA_V *a, HDA_V *r) {
    HDA_V other;
    HDA_GLUE(HDA_V, _sincos)(a, r, &other);
}

HDA_FUNCTION(cos)(const HDA_V *a, HDA_V *r) {
    HDA_V other;
    HDA_GLUE(HDA_V, _sincos)(a, &other, r);
}

HDA_FUNCTION(tan)(const HDA_V *a, HDA_V *r) {
    HDA_V s, c;
    HDA_GLUE(HDA_V, _sincos)(a, &s, &c);
    *r = s / c;
}

/* Above tan π/8 atan t = π/4 + atan((t − 1)/(t + 1)), above tan 3π/8 π/2 − atan 1/t. */
HDA_FUNCTION(atan)(const HDA_V *a, HDA_V *r) {
    HDA_V size;
    HDA_GLUE(HDA_V, _fabs)(a, &size);
    const HDA_I middle = size > 0.41421356237309503, far = size > 2.414213562373095;
    const HDA_V above = HDA_PICK(far, -1.0 - HDA_ZERO, HDA_PICK(middle, size - 1.0, size));
    const HDA_V below = HDA_PICK(far, size, HDA_PICK(middle, size + 1.0, 1.0 - HDA_ZERO));
    const HDA_V base =
        HDA_PICK(far, 1.5707963267948966 - HDA_ZERO, HDA_PICK(middle, 0.7853981633974483 - HDA_ZERO, HDA_ZERO));
    const HDA_V t = above / below, z = t * t, z2 = z * z, z4 = z2 * z2;
    const HDA_V low =
        (-0.3333333333333333 + z * 0.1999999999999552) + z2 * (-0.14285714284666542 + z * 0.11111111015256361);
    const HDA_V mid =
        (-0.09090904578123903 + z * 0.07692183190826087) + z2 * (-0.06664511447381948 + z * 0.0585814891280221);
    const HDA_V top = (-0.0508544973794026 + z * 0.03923165829558719) + z2 * -0.01917688711906226;
    const HDA_V value = base + (t + t * z * (low + z4 * (mid + z4 * top)));
    *r = (HDA_V)(HDA_BITS(value) | (HDA_BITS(*a) & HDA_BITS(-HDA_ZERO)));
}

HDA_FUNCTION(tanh)(const HDA_V *a, HDA_V *r) {
    const HDA_V magic = 6755399441055744.0 - HDA_ZERO;
    HDA_V size;
    HDA_GLUE(HDA_V, _fabs)(a, &size);
    const HDA_V x = HDA_LESSER(20.0 - HDA_ZERO, size);
    const HDA_V shifted = x * -2.8853900817779268 + magic;
    const HDA_V n = shifted - magic;
    /* exp(-2 |a|) = 2^n exp(-2 h); what h loses with n counts 2^n times */
    const HDA_V h = x + n * 3.4657359027997264e-1;
    const HDA_V h2 = h * h, h4 = h2 * h2;
    const HDA_V low = (1.0 - 2.0 * h) + h2 * (2.0000000000000004 - h * 1.3333333333333335);
    const HDA_V mid = (16 * 0.04166666666662413 - h * (32 * 0.008333333333330062)) +
                      h2 * (64 * 0.0013888888917213717 - h * (128 * 0.00019841269863053618));
    const HDA_V top = (256 * 2.4801521295954376e-05 - h * (512 * 2.7557268459997064e-06)) +
                      h2 * (1024 * 2.7620088445409746e-07 - h * (2048 * 2.510038549551032e-08));
    const HDA_V value = low + h4 * (mid + h4 * top);
    const HDA_V power = (HDA_V)((HDA_BITS(shifted) << 52) + HDA_BITS(1.0 - HDA_ZERO));
    const HDA_V t = (1.0 - value * power) / (1.0 + value * power);
    *r = (HDA_V)(HDA_BITS(t) | (HDA_BITS(*a) & HDA_BITS(-HDA_ZERO)));
}

#undef HDA_GLUE_
#undef HDA_GLUE
#undef HDA_I
#undef HDA_FUNCTION
#undef HDA_BITS
#undef HDA_PICK
#undef HDA_ZERO
#undef HDA_IF_ODD
#undef HDA_LESSER
#undef HDA_GREATER
#undef HDA_BELOW
