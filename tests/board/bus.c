/* A bus for tests/board/cost and tests/daemon, and for trying headingd without hardware: preloaded into the daemon, it answers for
 * /dev/i2c-9 at once, so that the daemon runs on the machine's own kernel and nothing but its own work is measured. Three chips
 * with noise, on a level board; the field is that of `headingd simulate`, so that a calibration on such a log fits.
 *
 * Variables of the environment:
 *   BUS_MAGNETOMETER  what is there in place of an HMC5843: "qmc5883l"
 *   BUS_BOARD         "stick": the chips lie as on SparkFun's 9DOF Sensor Stick; else all along the body's axes
 *   BUS_MOTION        "turn": rests 4 s, turns by 400 degrees in 8 s, is swung about in 12 s, and begins again; else it rests */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <linux/i2c-dev.h>
#include <linux/i2c.h>

static uint8_t registers[128][256];
static uint8_t address_of[1024];

static int says(const char *variable, const char *word) {
    const char *said = getenv(variable);
    return said && strcmp(said, word) == 0;
}

static uint32_t noise(void) {
    static uint32_t state = 1;
    state = state * 1664525u + 1013904223u;
    return state >> 29;
}

static int open_it(const char *path, int flags, mode_t mode, const char *name) {
    int (*real)(const char *, int, ...) = (int (*)(const char *, int, ...))dlsym(RTLD_NEXT, name);
    if (strcmp(path, "/dev/i2c-9") != 0)
        return real(path, flags, mode);
    int file = real("/dev/null", O_RDWR | O_CLOEXEC);
    if (file >= 0 && file < 1024)
        address_of[file] = 127;
    memcpy(registers[0x1e] + 0x0a, "H43", 3);
    registers[0x0d][0x0d] = 0xff;
    registers[0x68][0x00] = 0x68;
    registers[0x53][0x00] = 0xe5;
    return file;
}

#define OPEN(name)                              \
    int name(const char *path, int flags, ...) {\
        va_list more;                           \
        va_start(more, flags);                  \
        mode_t mode = va_arg(more, mode_t);     \
        va_end(more);                           \
        return open_it(path, flags, mode, #name);\
    }
OPEN(open)
OPEN(open64)

static double now_s(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec + 1e-9 * now.tv_nsec;
}

/* Heading, pitch and roll, radians, and how fast they change. */
struct pose {
    double angle[3], rate[3];
};

/* How far something that takes this long has come, 0 to 1, and how fast it goes: it begins and ends gently. */
static double share(double t_s, double length_s, double *rate) {
    double phase = 2 * M_PI * t_s / length_s;
    *rate = (1 - cos(phase)) / length_s;
    return t_s / length_s - sin(phase) / (2 * M_PI);
}

static struct pose pose(void) {
    static double begun_s;
    static int moves;
    if (begun_s == 0) {
        begun_s = now_s();
        moves = says("BUS_MOTION", "turn");
    }
    struct pose here = {0};
    if (!moves)
        return here;
    double t_s = now_s() - begun_s;
    double cycles = floor(t_s / 24), in_s = t_s - 24 * cycles;
    double turn = 400 * M_PI / 180, rate;
    here.angle[0] = turn * cycles;
    if (in_s > 12) {
        here.angle[0] += turn;
        for (int axis = 1; axis < 3; axis++) {
            double w = 2 * M_PI * axis / 6, envelope_s = in_s - 12;
            double up = sin(M_PI * envelope_s / 12), up_rate = M_PI / 12 * cos(M_PI * envelope_s / 12);
            here.angle[axis] = 0.7 * up * up * sin(w * envelope_s);
            here.rate[axis] = 0.7 * up * (2 * up_rate * sin(w * envelope_s) + up * w * cos(w * envelope_s));
        }
    } else if (in_s > 4) {
        here.angle[0] += turn * share(in_s - 4, 8, &rate);
        here.rate[0] = turn * rate;
    }
    return here;
}

/* A vector of north, east and down in body axes: forward, right, down. */
static void to_body(const struct pose *here, double north, double down, double body[3]) {
    double cy = cos(here->angle[0]), sy = sin(here->angle[0]);
    double cp = cos(here->angle[1]), sp = sin(here->angle[1]);
    double cr = cos(here->angle[2]), sr = sin(here->angle[2]);
    double x = north * cy, y = -north * sy;
    body[0] = x * cp - down * sp;
    double z = x * sp + down * cp;
    body[1] = y * cr + z * sr;
    body[2] = z * cr - y * sr;
}

/* Body axes into those of the magnetometer, and of the others. */
static void to_chip(int magnetometer, double body[3]) {
    if (!says("BUS_BOARD", "stick"))
        return;
    double x = body[0], y = body[1];
    body[0] = magnetometer ? x : -y;
    body[1] = magnetometer ? -y : -x;
    body[2] = -body[2];
}

static void put(uint8_t *at, int low_first, double counts) {
    int16_t rounded = (int16_t)lrint(counts);
    at[low_first ? 0 : 1] = rounded & 0xff;
    at[low_first ? 1 : 0] = (rounded >> 8) & 0xff;
}

/* Counts of the HMC5843, with the iron of `headingd simulate`; in its self-test, of the field that it makes itself. */
static void measure_hmc5843(uint8_t *at) {
    static const double counts_per_gauss[] = {1620, 1300, 970, 780, 530, 460, 390, 280};
    static const double scale[] = {0.873, 0.998, 0.94}, bias[] = {87.28, 54.19, 135.0};
    double gain = counts_per_gauss[at[1] >> 5] / 1000;
    int straps = at[0] & 3;
    struct pose here = pose();
    double field[3];
    to_body(&here, 162.8, 526.7, field);
    to_chip(1, field);
    for (int axis = 0; axis < 3; axis++) {
        double mgauss = scale[axis] * field[axis] + bias[axis];
        if (straps)
            mgauss = straps == 1 ? 550 : -550;
        put(at + 3 + 2 * axis, 0, mgauss * gain + noise() - 3.5);
    }
    at[9] = 1;
}

/* The magnetometer measures 50 times a second, and at once in its self-test; the others when they are asked. */
static void measure(uint8_t address) {
    static long slot;
    long current = (long)(now_s() * 50);
    uint8_t *at = registers[address];
    double body[3];
    if (address == 0x0d && current != slot) {
        /* Low byte first, 12 counts a milligauss. */
        uint8_t data[] = {noise(), 10, noise(), 2, noise(), 25, 1};
        if (at[0x09] & 1)
            memcpy(at, data, sizeof data);
        slot = current;
    } else if (address == 0x1e && current != slot) {
        measure_hmc5843(at);
        slot = current;
    } else if (address == 0x68) {
        struct pose here = pose();
        const double *rate = here.rate;
        double cp = cos(here.angle[1]), sp = sin(here.angle[1]), cr = cos(here.angle[2]), sr = sin(here.angle[2]);
        body[0] = rate[2] - rate[0] * sp;
        body[1] = rate[1] * cr + rate[0] * sr * cp;
        body[2] = -rate[1] * sr + rate[0] * cr * cp;
        to_chip(0, body);
        for (int axis = 0; axis < 3; axis++)
            put(at + 0x1d + 2 * axis, 0, body[axis] * 180 / M_PI * 14.375 + noise());
    } else if (address == 0x53) {
        /* Specific force points up: a level board has -9.81 m/s2, 256 counts, on body Z. */
        struct pose here = pose();
        to_body(&here, 0, -256, body);
        to_chip(0, body);
        /* Along gravity noise tilts nothing. */
        for (int axis = 0; axis < 3; axis++)
            put(at + 0x32 + 2 * axis, 1, body[axis] + (axis == 2 ? noise() - 3.5 : 0));
    }
}

/* An HMC5843 has no averaging: of its first register it keeps the rate and the self-test alone. */
static int keeps_all_bits(uint8_t address, uint8_t command) {
    return address != 0x1e || command != 0;
}

int ioctl(int file, unsigned long request, ...) {
    va_list more;
    va_start(more, request);
    void *argument = va_arg(more, void *);
    va_end(more);
    if (file < 0 || file >= 1024 || address_of[file] == 0) {
        int (*real)(int, unsigned long, ...) = (int (*)(int, unsigned long, ...))dlsym(RTLD_NEXT, "ioctl");
        return real(file, request, argument);
    }
    if (request == I2C_SLAVE)
        address_of[file] = (uintptr_t)argument & 127;
    if (request != I2C_SMBUS)
        return 0;
    uint8_t address = address_of[file];
    struct i2c_smbus_ioctl_data *transfer = argument;
    if (address != (says("BUS_MAGNETOMETER", "qmc5883l") ? 0x0d : 0x1e) && address != 0x68 && address != 0x53) {
        errno = ENXIO;
        return -1;
    }
    uint8_t *at = registers[address] + transfer->command;
    if (transfer->read_write == I2C_SMBUS_READ) {
        measure(address);
        memcpy(transfer->data->block + 1, at, transfer->data->block[0]);
    } else {
        *at = transfer->data->byte & (keeps_all_bits(address, transfer->command) ? 0xff : 0x1f);
    }
    return 0;
}
