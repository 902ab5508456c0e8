/* The parts of HAL and RTAPI that a kinematics component calls, in one process: memory, pins that are plain variables, messages to stderr. */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#include "hal.h"
#include "rtapi.h"

void (*stub_update)(void *, long);
hal_bit_t *stub_enable;
double *stub_slew, *stub_weight;

int hal_init(const char *name) { (void)name; return 7; }
int hal_ready(int id) { return id == 7 ? 0 : -1; }
int hal_exit(int id) { return id == 7 ? 0 : -1; }
void *hal_malloc(long size) { return calloc(1, size); }

int hal_pin_bit_newf(hal_pin_dir_t dir, hal_bit_t **pin, int id, const char *name, ...)
{
    *pin = calloc(1, sizeof **pin);
    if (dir == HAL_IN)
        stub_enable = (hal_bit_t *)*pin;
    return id == 7 && name ? 0 : -1;
}

int hal_pin_float_newf(hal_pin_dir_t dir, hal_float_t **pin, int id, const char *name, ...)
{
    *pin = calloc(1, sizeof **pin);
    stub_weight = (double *)*pin;
    return id == 7 && name && dir ? 0 : -1;
}

int hal_param_float_newf(hal_param_dir_t dir, hal_float_t *param, int id, const char *name, ...)
{
    stub_slew = (double *)param;
    return id == 7 && name && dir ? 0 : -1;
}

int hal_param_u32_newf(hal_param_dir_t dir, hal_u32_t *param, int id, const char *name, ...)
{
    return id == 7 && name && dir && param ? 0 : -1;
}

int hal_export_funct(const char *name, void (*function)(void *, long), void *arg, int fp, int reentrant, int id)
{
    (void)arg, (void)fp, (void)reentrant;
    stub_update = function;
    return id == 7 && name ? 0 : -1;
}

void rtapi_print_msg(msg_level_t level, const char *text, ...)
{
    va_list rest;

    (void)level;
    va_start(rest, text);
    vfprintf(stderr, text, rest);
    va_end(rest);
}

void stub_set(char **coordinates, char **lattice, int *vertices, int *inch, char *letters, char *path, int rows, int inches)
{
    *coordinates = letters;
    *lattice = path;
    *vertices = rows;
    *inch = inches;
}

void stub_step(int on, double slew, long period_ns)
{
    *(volatile unsigned char *)stub_enable = (unsigned char)on;
    *stub_slew = slew;
    stub_update(NULL, period_ns);
}
