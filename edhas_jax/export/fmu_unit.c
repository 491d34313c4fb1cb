/* An FMI 2.0 co-simulation unit around the machine of machine.h: a fixed step, one flat state, no shared data. */

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "machine.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif

/* in a program that holds several units at once, each has a prefix of its own */
#if defined(FMI2_FUNCTION_PREFIX) && !defined(FMI2_OVERRIDE_FUNCTION_PREFIX)
#define PASTE(a, b) a##b
#define PASTED(a, b) PASTE(a, b)
#define FMI(name) PASTED(FMI2_FUNCTION_PREFIX, name)
#else
#define FMI(name) name
#endif

typedef void *Instance;
typedef void *Saved;
typedef unsigned int Reference;
typedef int Boolean;
typedef const char *String;
typedef enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING } Status;
typedef enum { DO_STEP_STATUS, PENDING_STATUS, LAST_SUCCESSFUL_TIME, TERMINATED_STATUS } StatusKind;
typedef enum { MODEL_EXCHANGE, CO_SIMULATION } Kind;

typedef struct {
    void (*logger)(void *environment, String instance, Status status, String category, String message, ...);
    void *(*allocate)(size_t count, size_t size);
    void (*release)(void *memory);
    void (*finished)(void *environment, Status status);
    void *environment;
} Callbacks;

typedef enum { INSTANTIATED, INITIALIZING, STEPPING, DONE } Phase;

/* all that a saved state has to hold */
typedef struct {
    double value[VALUES], y[STATES];
    double time, since, h; /* since: the time of the last inputs */
    Phase phase;
    Boolean left_range;
} State;

typedef struct {
    State now;
    double kept[KEPT], seen[SIGNALS];
    Boolean is_kept, is_seen; /* whether `kept` and `seen` belong to `now` */
    const Callbacks *callbacks;
    char *name;
} Unit;

static Status say(const Unit *u, Status status, String message)
{
    if (u->callbacks && u->callbacks->logger)
        u->callbacks->logger(u->callbacks->environment, u->name, status,
                             status == DISCARD ? "logStatusDiscard" : "logStatusError", "%s", message);
    return status;
}

static void forget(Unit *u)
{
    u->is_kept = u->is_seen = 0;
}

static void rewind_unit(Unit *u)
{
    memset(&u->now, 0, sizeof u->now);
    memcpy(u->now.value, START, sizeof START);
    forget(u);
}

/* the machine at rest, as its parameters now are */
static void rest(Unit *u)
{
    State *s = &u->now;
    s->h = s->value[STEP];
    machine_start(s->value, s->y, s->time, s->h, s->since, NULL, s->y);
    forget(u);
}

static void see(Unit *u)
{
    State *s = &u->now;
    double curve[CURVES];
    if (u->is_seen) return;
    if (s->phase < STEPPING) rest(u);
    machine_curves(s->time, curve);
    machine_see(s->value, s->y, s->time, s->h, s->since, curve, u->seen);
    u->is_seen = 1;
}

EXPORT String FMI(fmi2GetTypesPlatform)(void)
{
    return "default";
}

EXPORT String FMI(fmi2GetVersion)(void)
{
    return "2.0";
}

EXPORT Instance FMI(fmi2Instantiate)(String name, Kind kind, String guid, String resources, const Callbacks *callbacks,
                                     Boolean visible, Boolean logging)
{
    Unit *u = calloc(1, sizeof *u);
    (void)resources, (void)visible, (void)logging;
    if (!u) return NULL;
    u->callbacks = callbacks;
    u->name = calloc(name ? strlen(name) + 1 : 1, 1);
    if (u->name && name) strcpy(u->name, name);
    if (!u->name || kind != CO_SIMULATION || !guid || strcmp(guid, GUID)) {
        say(u, ERROR, kind == CO_SIMULATION ? "the GUID is not that of this unit: modelDescription.xml is another's"
                                            : "this unit is for co-simulation only");
        free(u->name);
        free(u);
        return NULL;
    }
    rewind_unit(u);
    return u;
}

EXPORT void FMI(fmi2FreeInstance)(Instance c)
{
    if (!c) return;
    free(((Unit *)c)->name);
    free(c);
}

EXPORT Status FMI(fmi2SetDebugLogging)(Instance c, Boolean on, size_t count, const String categories[])
{
    (void)c, (void)on, (void)count, (void)categories;
    return OK;
}

EXPORT Status FMI(fmi2SetupExperiment)(Instance c, Boolean has_tolerance, double tolerance, double start,
                                       Boolean has_stop, double stop)
{
    Unit *u = c;
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    if (u->now.phase != INSTANTIATED) return say(u, ERROR, "the experiment is set up before initialization");
    if (!isfinite(start)) return say(u, ERROR, "the start time is not a finite number");
    u->now.time = u->now.since = start;
    forget(u);
    return OK;
}

EXPORT Status FMI(fmi2EnterInitializationMode)(Instance c)
{
    Unit *u = c;
    if (u->now.phase != INSTANTIATED) return say(u, ERROR, "initialization was entered before");
    u->now.phase = INITIALIZING;
    return OK;
}

EXPORT Status FMI(fmi2ExitInitializationMode)(Instance c)
{
    Unit *u = c;
    if (u->now.phase != INITIALIZING) return say(u, ERROR, "initialization was not entered");
    rest(u);
    u->now.phase = STEPPING;
    return OK;
}

EXPORT Status FMI(fmi2Terminate)(Instance c)
{
    ((Unit *)c)->now.phase = DONE;
    return OK;
}

EXPORT Status FMI(fmi2Reset)(Instance c)
{
    rewind_unit(c);
    return OK;
}

EXPORT Status FMI(fmi2GetReal)(Instance c, const Reference which[], size_t count, double out[])
{
    Unit *u = c;
    size_t k;
    for (k = 0; k < count; ++k) {
        if (which[k] < VALUES) {
            out[k] = u->now.value[which[k]];
        } else if (which[k] < VALUES + SIGNALS) {
            see(u);
            out[k] = u->seen[which[k] - VALUES];
        } else {
            return say(u, ERROR, "there is no variable with this value reference");
        }
    }
    return OK;
}

EXPORT Status FMI(fmi2SetReal)(Instance c, const Reference which[], size_t count, const double in[])
{
    Unit *u = c;
    char text[512];
    size_t k;
    for (k = 0; k < count; ++k) {
        const Reference r = which[k];
        if (r >= VALUES) return say(u, ERROR, "an output cannot be set");
        if (u->now.phase >= STEPPING && !IS_INPUT[r]) {
            snprintf(text, sizeof text,
                     "%s: a parameter is set before initialization ends; export with --input %s to change it later",
                     NAMES[r], NAMES[r]);
            return say(u, ERROR, text);
        }
        if (!(in[k] >= LOWEST[r] && in[k] <= HIGHEST[r])) {
            snprintf(text, sizeof text, "%s: must %s; got %g", NAMES[r], ALLOWED[r], in[k]);
            return say(u, ERROR, text);
        }
        if (u->now.value[r] != in[k]) u->is_kept = 0;
        u->now.value[r] = in[k];
    }
    if (count) {
        u->now.since = u->now.time;
        u->is_seen = 0;
    }
    return OK;
}

EXPORT Status FMI(fmi2DoStep)(Instance c, double begin, double size, Boolean no_return)
{
    Unit *u = c;
    State *s = &u->now;
    double next[STATES + 1], curve[CURVES], count, h, i;
    char text[512];
    (void)no_return;
    if (s->phase != STEPPING) return say(u, ERROR, "a step is taken after initialization and before the end");
    if (!(size >= 0.0) || !isfinite(begin + size))
        return say(u, ERROR, "the length of a communication step must be a finite number from 0");
    if (fabs(begin - s->time) > 1e-9 * fabs(begin) + 1e-3 * s->value[STEP]) {
        snprintf(text, sizeof text, "a step from %.9g s was asked for, but this unit stands at %.9g s", begin, s->time);
        return say(u, ERROR, text);
    }
    if (size == 0.0) return OK;
    /* equal steps, none longer than asked for; a hair of slack for a length that was added up */
    count = fmax(1.0, ceil(size / s->value[STEP] - 1e-6));
    h = size / count;
    if (fabs(h - s->h) <= 1e-9 * h) h = s->h;
    if (!u->is_kept || h != s->h) {
        s->h = h;
        machine_step_invariants(s->value, s->y, begin, h, begin, curve, u->kept);
        u->is_kept = 1;
    }
    s->since = begin;
    s->left_range = 0;
    u->is_seen = 0;
    for (i = 0.0; i < count; ++i) {
        const double t = begin + i * h;
        machine_curves(t + 0.5 * h, curve);
        machine_step(s->value, s->y, t, h, begin, curve, u->kept, next);
        if (next[STATES] >= 0.0) {
            s->time = t;
            s->left_range = 1;
            snprintf(text, sizeof text,
                     "at %.6g s %s (step %.4g \302\265s); the machine is outside what the model describes, or the step "
                     "is too large for it: try a smaller step", t + h, FAILURES[(int)next[STATES]], h * 1e6);
            return say(u, DISCARD, text);
        }
        memcpy(s->y, next, sizeof s->y);
    }
    s->time = begin + size;
    return OK;
}

EXPORT Status FMI(fmi2CancelStep)(Instance c)
{
    return say(c, ERROR, "no step is ever pending");
}

EXPORT Status FMI(fmi2GetStatus)(Instance c, const StatusKind kind, Status *out)
{
    (void)kind;
    *out = ((Unit *)c)->now.left_range ? DISCARD : OK;
    return OK;
}

EXPORT Status FMI(fmi2GetRealStatus)(Instance c, const StatusKind kind, double *out)
{
    if (kind != LAST_SUCCESSFUL_TIME) return DISCARD;
    *out = ((Unit *)c)->now.time;
    return OK;
}

EXPORT Status FMI(fmi2GetIntegerStatus)(Instance c, const StatusKind kind, int *out)
{
    (void)c, (void)kind, (void)out;
    return DISCARD;
}

EXPORT Status FMI(fmi2GetBooleanStatus)(Instance c, const StatusKind kind, Boolean *out)
{
    if (kind != TERMINATED_STATUS) return DISCARD;
    *out = ((Unit *)c)->now.left_range;
    return OK;
}

EXPORT Status FMI(fmi2GetStringStatus)(Instance c, const StatusKind kind, String *out)
{
    (void)c, (void)kind, (void)out;
    return DISCARD;
}

EXPORT Status FMI(fmi2GetFMUstate)(Instance c, Saved *state)
{
    if (!*state) *state = malloc(sizeof(State));
    if (!*state) return say(c, ERROR, "no memory for a state");
    memcpy(*state, &((Unit *)c)->now, sizeof(State));
    return OK;
}

EXPORT Status FMI(fmi2SetFMUstate)(Instance c, Saved state)
{
    memcpy(&((Unit *)c)->now, state, sizeof(State));
    forget(c);
    return OK;
}

EXPORT Status FMI(fmi2FreeFMUstate)(Instance c, Saved *state)
{
    (void)c;
    if (state) {
        free(*state);
        *state = NULL;
    }
    return OK;
}

EXPORT Status FMI(fmi2SerializedFMUstateSize)(Instance c, Saved state, size_t *size)
{
    (void)c, (void)state;
    *size = sizeof GUID + sizeof(State);
    return OK;
}

EXPORT Status FMI(fmi2SerializeFMUstate)(Instance c, Saved state, char bytes[], size_t size)
{
    if (size < sizeof GUID + sizeof(State)) return say(c, ERROR, "there are too few bytes for the state");
    memcpy(bytes, GUID, sizeof GUID);
    memcpy(bytes + sizeof GUID, state, sizeof(State));
    return OK;
}

EXPORT Status FMI(fmi2DeSerializeFMUstate)(Instance c, const char bytes[], size_t size, Saved *state)
{
    if (size < sizeof GUID + sizeof(State) || memcmp(bytes, GUID, sizeof GUID))
        return say(c, ERROR, "these bytes are not a state of this unit");
    if (!*state) *state = malloc(sizeof(State));
    if (!*state) return say(c, ERROR, "no memory for a state");
    memcpy(*state, bytes + sizeof GUID, sizeof(State));
    return OK;
}

EXPORT Status FMI(fmi2GetDirectionalDerivative)(Instance c, const Reference z[], size_t nz, const Reference v[],
                                                size_t nv, const double dv[], double dz[])
{
    (void)z, (void)nz, (void)v, (void)nv, (void)dv, (void)dz;
    return say(c, ERROR, "this unit has no directional derivatives");
}

EXPORT Status FMI(fmi2SetRealInputDerivatives)(Instance c, const Reference which[], size_t count, const int order[],
                                               const double in[])
{
    (void)which, (void)order, (void)in;
    return count ? say(c, ERROR, "inputs of this unit are held; it takes no derivatives of them") : OK;
}

EXPORT Status FMI(fmi2GetRealOutputDerivatives)(Instance c, const Reference which[], size_t count, const int order[],
                                                double out[])
{
    (void)which, (void)order, (void)out;
    return count ? say(c, ERROR, "this unit has no derivatives of outputs") : OK;
}

/* every variable is a real number */
#define NO_SUCH(Type, Name)                                                                              \
    EXPORT Status FMI(fmi2Get##Name)(Instance c, const Reference which[], size_t count, Type out[])      \
    {                                                                                                    \
        (void)which, (void)out;                                                                          \
        return count ? say(c, ERROR, "every variable of this unit is a real number") : OK;               \
    }                                                                                                    \
    EXPORT Status FMI(fmi2Set##Name)(Instance c, const Reference which[], size_t count, const Type in[]) \
    {                                                                                                    \
        (void)which, (void)in;                                                                           \
        return count ? say(c, ERROR, "every variable of this unit is a real number") : OK;               \
    }

NO_SUCH(int, Integer)
NO_SUCH(Boolean, Boolean)
NO_SUCH(String, String)
