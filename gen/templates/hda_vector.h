/* Vectors of HDA_W doubles and the elementary functions over them; included once for each width, with HDA_W and HDA_V defined.
 *
 * Legend: n multiple of the period, r reduced argument. Sources: reduction by parts (Cody, Waite, Software Manual for the
 * Elementary Functions, 1980), Taylor series on the reduced interval. exp, sin, cos, tan err by a few units in the last place,
 * tanh by 3e-16 absolute. Functions take pointers and are inlined: no vector crosses a call.
 */
#define HDA_GLUE_(a, b) a##b
#define HDA_GLUE(a, b) HDA_GLUE_(a, b)
#define HDA_I HDA_GLUE(HDA_V, _bits)
#define HDA_FUNCTION(name) static inline __attribute__((always_inline, unused)) void HDA_GLUE(HDA_GLUE(HDA_V, _), name)

typedef double HDA_V __attribute__((vector_size(8 * HDA_W)));
typedef long long HDA_I __attribute__((vector_size(8 * HDA_W)));
typedef double HDA_GLUE(HDA_V, _loose) __attribute__((vector_size(8 * HDA_W), aligned(8), may_alias)); /* over plain doubles */

#define HDA_BITS(a) ((HDA_I)(a))
#define HDA_PICK(mask, a, b) ((HDA_V)(((mask) & HDA_BITS(a)) | (~(mask) & HDA_BITS(b))))
#define HDA_ZERO ((HDA_V){0})

HDA_FUNCTION(fabs)(const HDA_V *a, HDA_V *r) { *r = (HDA_V)(HDA_BITS(*a) & ~HDA_BITS(-HDA_ZERO)); }

HDA_FUNCTION(sign)(const HDA_V *a, HDA_V *r) {
    const HDA_V one = 1.0 - HDA_ZERO;
    const HDA_V signed_one = (HDA_V)(HDA_BITS(one) | (HDA_BITS(*a) & HDA_BITS(-HDA_ZERO)));
    *r = HDA_PICK((*a < HDA_ZERO) | (*a > HDA_ZERO), signed_one, *a);
}

/* As in C: where one argument is NaN the other is the result. */
HDA_FUNCTION(fmin)(const HDA_V *a, const HDA_V *b, HDA_V *r) { *r = HDA_PICK((*a < *b) | (*b != *b), *a, *b); }
HDA_FUNCTION(fmax)(const HDA_V *a, const HDA_V *b, HDA_V *r) { *r = HDA_PICK((*a > *b) | (*b != *b), *a, *b); }

HDA_FUNCTION(exp)(const HDA_V *a, HDA_V *r) {
    const HDA_V magic = 6755399441055744.0 - HDA_ZERO; /* 1.5 · 2^52: adding it rounds to an integer in the low bits */
    const HDA_V x = HDA_PICK(*a < -708.0, -708.0 - HDA_ZERO, *a);
    const HDA_V shifted = x * 1.4426950408889634 + magic;
    const HDA_V n = shifted - magic;
    const HDA_V s = (x - n * 6.93145751953125e-1) - n * 1.42860682030941723212e-6;
    const HDA_V s2 = s * s, s4 = s2 * s2;
    const HDA_V low = (1.0 + s) + s2 * (0.5 + s * 1.6666666666666666e-1);
    const HDA_V mid = (4.1666666666666664e-2 + s * 8.3333333333333332e-3) + s2 * (1.3888888888888889e-3 + s * 1.9841269841269841e-4);
    const HDA_V top = (2.4801587301587302e-5 + s * 2.7557319223985893e-6) + s2 * (2.7557319223985888e-7 + s * 2.5052108385441720e-8);
    const HDA_V tip = 2.0876756987868099e-9 + s * 1.6059043836821613e-10;
    const HDA_V value = low + s4 * (mid + s4 * (top + s4 * tip));
    const HDA_V scaled = (HDA_V)(HDA_BITS(value) + (HDA_BITS(shifted) << 52));
    const HDA_V huge = HDA_PICK(*a > 709.0, INFINITY - HDA_ZERO, scaled);
    *r = HDA_PICK(*a == *a, HDA_PICK(*a < -708.0, HDA_ZERO, huge), *a);
}

/* Sine and cosine of the argument reduced to [−π/4, π/4], and the quadrant. Beyond 2^40 the argument has no angle left: NaN. */
HDA_FUNCTION(sincos)(const HDA_V *a, HDA_V *sine, HDA_V *cosine) {
    const HDA_V magic = 6755399441055744.0 - HDA_ZERO;
    const HDA_V shifted = *a * 6.36619772367581382433e-1 + magic;
    const HDA_V n = shifted - magic;
    const HDA_V z = ((*a - n * 1.57079632673412561417e+00) - n * 6.07710050630396597660e-11) - n * 2.02226624879595063154e-21;
    const HDA_V z2 = z * z, z4 = z2 * z2;
    const HDA_V s_low = -1.6666666666666666e-1 + z2 * 8.3333333333333332e-3;
    const HDA_V s_mid = -1.9841269841269841e-4 + z2 * 2.7557319223985893e-6;
    const HDA_V s_top = -2.5052108385441720e-8 + z2 * (1.6059043836821613e-10 + z2 * -7.6471637318198164e-13);
    const HDA_V s = z + z * z2 * (s_low + z4 * (s_mid + z4 * s_top));
    const HDA_V c_low = 4.1666666666666664e-2 + z2 * -1.3888888888888889e-3;
    const HDA_V c_mid = 2.4801587301587302e-5 + z2 * -2.7557319223985888e-7;
    const HDA_V c_top = 2.0876756987868099e-9 + z2 * (-1.1470745597729725e-11 + z2 * 4.7794773323873853e-14);
    const HDA_V c = (1.0 - 0.5 * z2) + z4 * (c_low + z4 * (c_mid + z4 * c_top));
    const HDA_I quadrant = HDA_BITS(shifted);
    const HDA_I swap = -(quadrant & 1);
    const HDA_V lost = HDA_PICK((*a < 1.099511627776e12) & (*a > -1.099511627776e12), HDA_ZERO, NAN - HDA_ZERO);
    *sine = (HDA_V)(HDA_BITS(HDA_PICK(swap, c, s)) ^ ((quadrant & 2) << 62)) + lost;
    *cosine = (HDA_V)(HDA_BITS(HDA_PICK(swap, s, c)) ^ (((quadrant + 1) & 2) << 62)) + lost;
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

HDA_FUNCTION(tanh)(const HDA_V *a, HDA_V *r) {
    HDA_V size, e;
    HDA_GLUE(HDA_V, _fabs)(a, &size);
    const HDA_V twice = -2.0 * size;
    HDA_GLUE(HDA_V, _exp)(&twice, &e);
    const HDA_V t = (1.0 - e) / (1.0 + e);
    *r = (HDA_V)(HDA_BITS(t) | (HDA_BITS(*a) & HDA_BITS(-HDA_ZERO)));
}

#undef HDA_GLUE_
#undef HDA_GLUE
#undef HDA_I
#undef HDA_FUNCTION
#undef HDA_BITS
#undef HDA_PICK
#undef HDA_ZERO
