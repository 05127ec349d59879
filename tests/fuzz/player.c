/* Plays calls to one FMU that bytes spell out, under AddressSanitizer and UndefinedBehaviorSanitizer: any function, in
 * any state, with odd arguments. What is seen besides what the sanitizers see: a status that is none, Fatal, a number
 * that is not finite with OK.
 *
 * Cases come from the standard input, each as its length (uint32_t) and its bytes; after each one byte goes back. */
#include "../fmi_calls.h"

#include <unistd.h>

enum { SAVED = 3, MOST = 1 << 16 };

static const unsigned char *at, *end;
static Instance c;
static double now, step;
static Saved saved[SAVED];

static unsigned byte(void) { return at < end ? *at++ : 0; }
static unsigned two(void) {
    const unsigned high = byte();
    return high << 8 | byte();
}

static int tracing;

static Status seen(Status status) {
    if (tracing) printf(" -> %d\n", (int)status);
    if ((unsigned)status > 3) {
        printf("a status of %d\n", (int)status);
        abort();
    }
    return status;
}

/* After a failed step an instance may be looked at, as FMI allows for debugging; nobody may go on with what it shows.
 */
static void finite(double value, const char *what) {
    if (isfinite(value) || do_step(c, now, step) > 1) return;
    printf("%s gives %g with OK, and goes on\n", what, value);
    abort();
}

/* A number that somebody forgot to think of; of a variable: about its limits. */
static double odd(const FmuVariable *v) {
    static const double others[] = {0.0, -0.0, 1.0, -1.0, 0.5, 1e-300, 5e-324, -5e-324, 1e-12, 1e6, -1e6, 1e18, 1e300,
        -1.7e308, 2147483648.0, 4294967296.0, 9007199254740993.0};
    const unsigned which = byte();
    if (which < 8) return which == 0 ? NAN : which == 1 ? INFINITY : which == 2 ? -INFINITY : 1.0 / which;
    if (v && which < 200) {
        const double start =
            v->role == FMU_PARAMETER || v->role == FMU_INPUT || v->role == FMU_STATE ? start_of(v) : 0.0;
        switch (which % 9) {
            case 0: return v->min;
            case 1: return v->max;
            case 2: return nextafter(v->min, -INFINITY);
            case 3: return nextafter(v->max, INFINITY);
            case 4: return nextafter(v->min, INFINITY);
            case 5: return nextafter(v->max, -INFINITY);
            case 6: return v->must_equal;
            case 7: return start * (1.0 + 1e-3 * (double)(byte() - 128.0));
            default: return start;
        }
    }
    return others[which % (sizeof others / sizeof *others)];
}

static unsigned reference(void) {
    const unsigned which = two();
    if (which > 0xfff0) return which == 0xffff ? 0xffffffffu : (unsigned)fmu_model.n_variables + which - 0xfff1;
    return which % (unsigned)fmu_model.n_variables;
}

static void set_one(void) {
    const unsigned r = reference();
    const FmuVariable *v = r < (unsigned)fmu_model.n_variables ? &fmu_model.variables[r] : &fmu_model.variables[0];
    double value = odd(v);
    if (v->type != FMU_FLOAT64 && !(fabs(value) < 2147483647.0)) value = 2147483647.0; /* the cast would be ours */
    if (v->size == 1) (void)seen(set(c, r, v, value));
}

static void get_one(void) {
    const unsigned r = reference();
    const FmuVariable *v = r < (unsigned)fmu_model.n_variables ? &fmu_model.variables[r] : &fmu_model.variables[0];
    double room[2] = {0.0, 0.0};
    if (v->size == 1 && seen(get(c, r, v, room)) == 0 && v->type == FMU_FLOAT64) finite(room[0], v->name);
}

/* Several at once, by references that may not be there or be of another type, and counts that do not fit. */
static void several(int setting) {
    unsigned references[8];
    double values[8];
    const size_t n = byte() % 9;
    for (size_t i = 0; i < n; i++) references[i] = reference(), values[i] = odd(NULL);
    const unsigned *r = byte() == 0 ? NULL : references;
    double *v = byte() == 0 ? NULL : values;
    const unsigned kind = byte() % 3;
    int whole[8] = {0};
#if FMI == 2
    if (kind == 0) (void)seen(setting ? fmi2SetReal(c, r, n, v) : fmi2GetReal(c, r, n, v));
    if (kind == 1) (void)seen(setting ? fmi2SetInteger(c, r, n, whole) : fmi2GetInteger(c, r, n, whole));
    if (kind == 2) (void)seen(setting ? fmi2SetBoolean(c, r, n, whole) : fmi2GetBoolean(c, r, n, whole));
#else
    fmi3Boolean flags[8] = {0};
    const size_t m = byte() % 4 ? n : byte() % 9;
    if (kind == 0) (void)seen(setting ? fmi3SetFloat64(c, r, n, v, m) : fmi3GetFloat64(c, r, n, v, m));
    if (kind == 1)
        (void)seen(
            setting ? fmi3SetInt32(c, r, n, (fmi3Int32 *)whole, m) : fmi3GetInt32(c, r, n, (fmi3Int32 *)whole, m));
    if (kind == 2) (void)seen(setting ? fmi3SetBoolean(c, r, n, flags, m) : fmi3GetBoolean(c, r, n, flags, m));
#endif
}

static void all_inputs(void) {
    for (int i = 0; i < fmu_model.n_variables; i++) {
        const FmuVariable *v = &fmu_model.variables[i];
        if (v->role == FMU_INPUT && v->type == FMU_FLOAT64 && v->size == 1) (void)seen(set(c, (unsigned)i, v, odd(v)));
    }
}

/* Initialization, mostly with arguments that make sense. */
static void begin(void) {
    const int usual = byte() % 4 != 0;
    const double tolerance = usual ? 1e-6 : odd(NULL), start = usual ? 0.0 : odd(NULL), stop = usual ? 1e3 : odd(NULL);
    const int has_tolerance = byte() % 2, has_stop = byte() % 4 == 0;
#if FMI == 2
    (void)seen(fmi2SetupExperiment(c, has_tolerance, tolerance, start, has_stop, stop));
    (void)seen(fmi2EnterInitializationMode(c));
#else
    (void)seen(fmi3EnterInitializationMode(c, has_tolerance, tolerance, start, has_stop, stop));
#endif
    now = usual ? 0.0 : start;
}

static void forget(void) {
    for (int i = 0; i < SAVED; i++)
        if (c && saved[i]) (void)STATE(Free, )(c, &saved[i]);
}

/* The present state as bytes, changed here and there, with a checksum that fits again (fmu_core.c: the last 8 bytes of
 * a head of 40, FNV-1a of the rest): refused, or good to go on with. */
static void forge(void) {
    enum { HEADER = 40, CHECKSUM = 32 };
    Saved state = NULL;
    size_t size = 0;
    if (seen(STATE(Get, )(c, &state)) != 0) return;
    if (seen(STATE(Serialized, Size)(c, state, &size)) != 0) abort();
    unsigned char *bytes = malloc(size);
    if (seen(STATE(Serialize, )(c, state, (void *)bytes, size)) != 0) abort();
    (void)STATE(Free, )(c, &state);
    for (unsigned n = byte() % 6; n > 0; n--) {
        const size_t place = byte() % 4 ? HEADER + two() * 8u % (size - HEADER) : two() % size;
        const double value = odd(NULL);
        if (byte() % 4 && place + 8 <= size) memcpy(bytes + place, &value, 8);
        else bytes[place] ^= (unsigned char)(1u << byte() % 8);
    }
    if (byte() % 8) {
        const uint64_t h = fmu_hash(bytes + HEADER, size - HEADER);
        memcpy(bytes + CHECKSUM, &h, sizeof h);
    }
    const size_t n = byte() % 8 ? size : two() % (size + 1);
    if (seen(DESERIALIZE(c, (void *)bytes, n, &state)) == 0) {
        if (seen(STATE(Set, )(c, state)) != 0) abort();
        (void)STATE(Free, )(c, &state);
        (void)seen(do_step(c, now, step));
    }
    free(bytes);
}

static void differentiate(void) {
    unsigned of[3], by[3];
    double seeds[3], results[3] = {0};
    const size_t n = byte() % 4, m = byte() % 4;
    for (size_t i = 0; i < 3; i++) of[i] = reference(), by[i] = reference(), seeds[i] = odd(NULL);
    Status status;
#if FMI == 2
    status = fmi2GetDirectionalDerivative(c, of, n, by, m, seeds, results);
#else
    status = fmi3GetDirectionalDerivative(c, of, n, by, m, seeds, m, results, n);
#endif
    for (size_t i = 0; seen(status) == 0 && i < n; i++) finite(results[i], "a derivative");
}

/* Functions of Model Exchange, with as many numbers as there are states, or not. */
static void exchange(unsigned which) {
    const size_t right = (size_t)fmu_model.n_states, n = byte() % 8 ? right : byte();
    double *x = calloc((n > right ? n : right) + 1, sizeof *x);
    Flag event = 0, terminate = 0;
    if (which % 3 == 0)
        for (size_t i = 0; i < n; i++) x[i] = byte() % 2 ? odd(NULL) : 0.0;
    switch (which) {
        case 0: (void)seen(F(SetContinuousStates)(c, x, n)); break;
        case 1: (void)seen(F(GetContinuousStates)(c, x, n)); break;
        case 2: (void)seen(F(GetNominalsOfContinuousStates)(c, x, n)); break;
        case 3: (void)seen(F(SetTime)(c, odd(NULL))); break;
        case 4: (void)seen(F(EnterContinuousTimeMode)(c)); break;
        case 5: (void)seen(F(EnterEventMode)(c)); break;
        case 6: (void)seen(F(CompletedIntegratorStep)(c, byte() % 2, &event, &terminate)); break;
        case 7:
#if FMI == 2
            if (seen(fmi2GetDerivatives(c, x, n)) == 0)
#else
            if (seen(fmi3GetContinuousStateDerivatives(c, x, n)) == 0)
#endif
                for (size_t i = 0; i < n && i < right; i++) finite(x[i], "a derivative");
            break;
        default: {
#if FMI == 2
            fmi2EventInfo info;
            (void)seen(fmi2NewDiscreteStates(c, &info));
#else
            fmi3Boolean flags[5];
            double next;
            (void)seen(fmi3UpdateDiscreteStates(c, flags, flags + 1, flags + 2, flags + 3, flags + 4, &next));
#endif
        }
    }
    free(x);
}

static void call(unsigned what) {
    Saved *one = &saved[byte() % SAVED];
    if (tracing) printf("call %u", what % 24);
    switch (what % 24) {
        case 0: case 1:
            if (c && byte() % 4) break; /* a new one, now and then */
            forget();
            F(FreeInstance)(c);
            c = instantiate(byte() ? fmu_model.token : "another", what % 24 == 0);
            break;
        case 2: begin(); break;
        case 3: (void)seen(F(ExitInitializationMode)(c)); break;
        case 4: if (byte() % 4 == 0) (void)seen(F(Terminate)(c)); break;
        case 5:
            (void)seen(F(Reset)(c));
            now = 0.0;
            if (byte() % 4 == 0) break;
            begin();
            (void)seen(F(ExitInitializationMode)(c));
            break;
        case 6: case 7: set_one(); break;
        case 8: get_one(); break;
        case 9: several(1); break;
        case 10: several(0); break;
        case 11: all_inputs(); break;
        case 12: case 13: case 14:
            if (seen(do_step(c, now, step)) <= 1) now += step;
            break;
        case 15: (void)seen(do_step(c, byte() % 2 ? now : odd(NULL), byte() % 2 ? step : odd(NULL))); break;
        case 16: (void)seen(STATE(Get, )(c, one)); break;
        case 17: (void)seen(STATE(Set, )(c, *one)); break;
        case 18: if (c) (void)seen(STATE(Free, )(c, one)); break;
        case 19: case 20: forge(); break;
        case 21: differentiate(); break;
        case 22: {
            const char *categories[2] = {"logStatusError", "none, %s %n"};
            (void)seen(F(SetDebugLogging)(c, byte() % 2, byte() % 3, byte() % 8 ? categories : NULL));
            break;
        }
        default: exchange(byte() % 9);
    }
}

static void play(const unsigned char *bytes, size_t n) {
    at = bytes;
    end = bytes + n;
    now = 0.0;
    c = instantiate(fmu_model.token, byte() % 4 != 0);
    if (byte() % 4) { /* mostly on the way that leads somewhere */
        begin();
        (void)seen(F(ExitInitializationMode)(c));
    }
    while (at < end) call(byte());
    forget();
    F(FreeInstance)(c);
    c = NULL;
}

static int all(void *to, size_t n) {
    for (char *p = to; n > 0;) {
        const ssize_t done = read(0, p, n);
        if (done <= 0) return 0;
        p += done;
        n -= (size_t)done;
    }
    return 1;
}

int main(int argc, char **argv) {
    if (argc < 2) return 2;
    tracing = argc > 2; /* for whoever looks at one case */
    step = strtod(argv[1], NULL);
    setvbuf(stdout, NULL, _IONBF, 0);
    uint32_t n;
    static unsigned char bytes[MOST];
    while (all(&n, sizeof n) && n <= MOST && all(bytes, n)) {
        unsigned char *own = malloc(n ? n : 1); /* so that reading beyond it is seen */
        memcpy(own, bytes, n);
        play(own, n);
        free(own);
        if (write(1, "+", 1) != 1) return 3;
    }
    return 0;
}
