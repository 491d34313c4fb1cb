/* FMI 2.0 co-simulation interface around the model of machine.h: fixed internal step, no data shared by instances. */

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

/* in a program that contains several units, the functions of each have their own prefix */
#if defined(FMI2_FUNCTION_PREFIX) && !defined(FMI2_OVERRIDE_FUNCTION_PREFIX)
#define PASTE(a, b) a##b
#define PASTE_EXPANDED(a, b) PASTE(a, b)
#define FMI(name) PASTE_EXPANDED(FMI2_FUNCTION_PREFIX, name)
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

/* the complete state, which fmi2GetFMUstate saves */
typedef struct {
    double value[VALUES], y[STATES];
    double time, input_time, h; /* input_time: time of the last inputs */
    Phase phase;
    Boolean out_of_range;
} State;

typedef struct {
    State now;
    double invariants[INVARIANTS], outputs[OUTPUTS];
    Boolean invariants_valid, outputs_valid; /* whether these belong to `now` */
    const Callbacks *callbacks;
    char *name;
} Unit;

static Status report(const Unit *u, Status status, String message)
{
    if (u->callbacks && u->callbacks->logger)
        u->callbacks->logger(u->callbacks->environment, u->name, status,
                             status == DISCARD ? "logStatusDiscard" : "logStatusError", "%s", message);
    return status;
}

static void invalidate(Unit *u)
{
    u->invariants_valid = u->outputs_valid = 0;
}

static void reset_unit(Unit *u)
{
    memset(&u->now, 0, sizeof u->now);
    memcpy(u->now.value, START, sizeof START);
    invalidate(u);
}

/* the initial states for the present parameters */
static void initialize_states(Unit *u)
{
    State *s = &u->now;
    s->h = s->value[STEP];
    machine_initial_state(s->value, s->y, s->time, s->h, s->input_time, NULL, s->y);
    invalidate(u);
}

static void update_outputs(Unit *u)
{
    State *s = &u->now;
    double recorded[RECORDED_VALUES];
    if (u->outputs_valid) return;
    if (s->phase < STEPPING) initialize_states(u);
    machine_recorded_intervals(s->time, recorded);
    machine_outputs(s->value, s->y, s->time, s->h, s->input_time, recorded, u->outputs);
    u->outputs_valid = 1;
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
        report(u, ERROR, kind == CO_SIMULATION ? "the GUID differs: modelDescription.xml belongs to another unit"
                                            : "this unit is for co-simulation only");
        free(u->name);
        free(u);
        return NULL;
    }
    reset_unit(u);
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
    if (u->now.phase != INSTANTIATED) return report(u, ERROR, "the experiment must be set up before initialization");
    if (!isfinite(start)) return report(u, ERROR, "the start time is not a finite number");
    u->now.time = u->now.input_time = start;
    invalidate(u);
    return OK;
}

EXPORT Status FMI(fmi2EnterInitializationMode)(Instance c)
{
    Unit *u = c;
    if (u->now.phase != INSTANTIATED) return report(u, ERROR, "initialization was entered already");
    u->now.phase = INITIALIZING;
    return OK;
}

EXPORT Status FMI(fmi2ExitInitializationMode)(Instance c)
{
    Unit *u = c;
    if (u->now.phase != INITIALIZING) return report(u, ERROR, "initialization was not entered");
    initialize_states(u);
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
    reset_unit(c);
    return OK;
}

EXPORT Status FMI(fmi2GetReal)(Instance c, const Reference which[], size_t count, double out[])
{
    Unit *u = c;
    size_t k;
    for (k = 0; k < count; ++k) {
        if (which[k] < VALUES) {
            out[k] = u->now.value[which[k]];
        } else if (which[k] < VALUES + OUTPUTS) {
            update_outputs(u);
            out[k] = u->outputs[which[k] - VALUES];
        } else {
            return report(u, ERROR, "there is no variable with this value reference");
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
        if (r >= VALUES) return report(u, ERROR, "an output cannot be set");
        if (u->now.phase >= STEPPING && !IS_INPUT[r]) {
            snprintf(text, sizeof text,
                     "%s: a parameter can be set only until initialization ends; "
                     "export with --input %s to change it later",
                     NAMES[r], NAMES[r]);
            return report(u, ERROR, text);
        }
        if (!(in[k] >= LOWEST[r] && in[k] <= HIGHEST[r])) {
            snprintf(text, sizeof text, "%s: must %s; got %g", NAMES[r], ALLOWED[r], in[k]);
            return report(u, ERROR, text);
        }
        if (u->now.value[r] != in[k]) u->invariants_valid = 0;
        u->now.value[r] = in[k];
    }
    if (count) {
        u->now.input_time = u->now.time;
        u->outputs_valid = 0;
    }
    return OK;
}

EXPORT Status FMI(fmi2DoStep)(Instance c, double begin, double size, Boolean no_return)
{
    Unit *u = c;
    State *s = &u->now;
    double next[STATES + 1], recorded[RECORDED_VALUES], count, h, i;
    char text[512];
    (void)no_return;
    if (s->phase != STEPPING)
        return report(u, ERROR, "a step can be taken only after initialization and before termination");
    if (!(size >= 0.0) || !isfinite(begin + size))
        return report(u, ERROR, "the length of a communication step must be finite and not negative");
    if (fabs(begin - s->time) > 1e-9 * fabs(begin) + 1e-3 * s->value[STEP]) {
        snprintf(text, sizeof text, "a step from %.9g s was requested, but this unit is at %.9g s", begin, s->time);
        return report(u, ERROR, text);
    }
    if (size == 0.0) return OK;
    /* equal steps, none longer than the largest; the tolerance is for lengths with rounding errors */
    count = fmax(1.0, ceil(size / s->value[STEP] - 1e-6));
    h = size / count;
    if (fabs(h - s->h) <= 1e-9 * h) h = s->h;
    if (!u->invariants_valid || h != s->h) {
        s->h = h;
        machine_step_invariants(s->value, s->y, begin, h, begin, recorded, u->invariants);
        u->invariants_valid = 1;
    }
    s->input_time = begin;
    s->out_of_range = 0;
    u->outputs_valid = 0;
    for (i = 0.0; i < count; ++i) {
        const double t = begin + i * h;
        machine_recorded_intervals(t + 0.5 * h, recorded);
        machine_step(s->value, s->y, t, h, begin, recorded, u->invariants, next);
        if (next[STATES] >= 0.0) {
            s->time = t;
            s->out_of_range = 1;
            snprintf(text, sizeof text,
                     "at %.6g s %s (step %.4g \302\265s); the machine is outside what the model describes, or the step "
                     "is too large for it: try a smaller step", t + h, FAILURES[(int)next[STATES]], h * 1e6);
            return report(u, DISCARD, text);
        }
        memcpy(s->y, next, sizeof s->y);
    }
    s->time = begin + size;
    return OK;
}

EXPORT Status FMI(fmi2CancelStep)(Instance c)
{
    return report(c, ERROR, "no step is ever pending");
}

EXPORT Status FMI(fmi2GetStatus)(Instance c, const StatusKind kind, Status *out)
{
    (void)kind;
    *out = ((Unit *)c)->now.out_of_range ? DISCARD : OK;
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
    *out = ((Unit *)c)->now.out_of_range;
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
    if (!*state) return report(c, ERROR, "out of memory for a state");
    memcpy(*state, &((Unit *)c)->now, sizeof(State));
    return OK;
}

EXPORT Status FMI(fmi2SetFMUstate)(Instance c, Saved state)
{
    memcpy(&((Unit *)c)->now, state, sizeof(State));
    invalidate(c);
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
    if (size < sizeof GUID + sizeof(State)) return report(c, ERROR, "the buffer is too small for the state");
    memcpy(bytes, GUID, sizeof GUID);
    memcpy(bytes + sizeof GUID, state, sizeof(State));
    return OK;
}

EXPORT Status FMI(fmi2DeSerializeFMUstate)(Instance c, const char bytes[], size_t size, Saved *state)
{
    if (size < sizeof GUID + sizeof(State) || memcmp(bytes, GUID, sizeof GUID))
        return report(c, ERROR, "the buffer holds no state of this unit");
    if (!*state) *state = malloc(sizeof(State));
    if (!*state) return report(c, ERROR, "out of memory for a state");
    memcpy(*state, bytes + sizeof GUID, sizeof(State));
    return OK;
}

/* of outputs, states and their derivatives at the present instant, by inputs and states; until initialization ends by
   inputs and parameters, through the initial states too */
EXPORT Status FMI(fmi2GetDirectionalDerivative)(Instance c, const Reference z[], size_t nz, const Reference v[],
                                                size_t nv, const double dv[], double dz[])
{
    Unit *u = c;
    State *s = &u->now;
    double dvalue[VALUES] = {0.0}, dy[STATES] = {0.0}, change[OUTPUTS], recorded[RECORDED_VALUES];
    const Boolean initial = s->phase < STEPPING;
    size_t k;
    for (k = 0; k < nv; ++k) {
        const Reference r = v[k];
        if (r < VALUES && (initial || IS_INPUT[r]))
            dvalue[r] += dv[k];
        else if (!initial && r >= VALUES && r < VALUES + OUTPUTS && STATE_OF[r - VALUES] >= 0)
            dy[STATE_OF[r - VALUES]] += dv[k];
        else
            return report(u, ERROR, initial ? "until initialization ends, derivatives are by inputs and parameters"
                                            : "derivatives are by inputs and states");
    }
    for (k = 0; k < nz; ++k)
        if (z[k] < VALUES || z[k] >= VALUES + OUTPUTS)
            return report(u, ERROR, "derivatives are of outputs, states and their derivatives by time");
    if (initial) {
        initialize_states(u);
        machine_initial_direction(s->value, s->y, s->time, s->h, s->input_time, NULL, dvalue, dy, dy);
    }
    machine_recorded_intervals(s->time, recorded);
    machine_direction(s->value, s->y, s->time, s->h, s->input_time, recorded, dvalue, dy, change);
    for (k = 0; k < nz; ++k) dz[k] = change[z[k] - VALUES];
    return OK;
}

EXPORT Status FMI(fmi2SetRealInputDerivatives)(Instance c, const Reference which[], size_t count, const int order[],
                                               const double in[])
{
    (void)which, (void)order, (void)in;
    return count ? report(c, ERROR, "this unit holds its inputs constant; input derivatives are not supported") : OK;
}

EXPORT Status FMI(fmi2GetRealOutputDerivatives)(Instance c, const Reference which[], size_t count, const int order[],
                                                double out[])
{
    (void)which, (void)order, (void)out;
    return count ? report(c, ERROR, "this unit provides no derivatives of outputs") : OK;
}

/* every variable is a real number */
#define NO_VARIABLES_OF_TYPE(Type, Name)                                                                    \
    EXPORT Status FMI(fmi2Get##Name)(Instance c, const Reference which[], size_t count, Type out[])         \
    {                                                                                                       \
        (void)which, (void)out;                                                                             \
        return count ? report(c, ERROR, "every variable of this unit is a real number") : OK;               \
    }                                                                                                       \
    EXPORT Status FMI(fmi2Set##Name)(Instance c, const Reference which[], size_t count, const Type in[])    \
    {                                                                                                       \
        (void)which, (void)in;                                                                              \
        return count ? report(c, ERROR, "every variable of this unit is a real number") : OK;               \
    }

NO_VARIABLES_OF_TYPE(int, Integer)
NO_VARIABLES_OF_TYPE(Boolean, Boolean)
NO_VARIABLES_OF_TYPE(String, String)
