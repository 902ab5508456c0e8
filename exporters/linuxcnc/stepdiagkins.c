/* stepdiagkins: Cartesian kinematics of LinuxCNC with a volumetric compensation.
 *
 * Every joint stands where its axis is commanded plus what a lattice of vectors holds for that point of the volume. The lattice is
 * lattice.csv as `stepdiag export` writes it (x_mm,y_mm,z_mm,cx_um,cy_um,cz_um; z fastest; evenly spaced), read once when the module is
 * loaded; between the vertices it is interpolated linearly in three directions, outside it the values of its faces are held.
 *
 *   KINEMATICS = stepdiagkins coordinates=XYZ lattice=/path/lattice.csv vertices=2873
 *   addf stepdiagkins.update servo-thread        (after motion-controller)
 *   setp stepdiagkins.enable 1
 *
 * A cycle costs one interpolation in one direction and at most ROUNDS in the other; memory is fixed. A lattice that is not whole keeps
 * LinuxCNC from starting. Switching on and off moves no joint faster than slew-per-second.
 *
 * It is built against the headers of LinuxCNC, which are under the GNU General Public License, version 2.
 */

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "rtapi.h"
#include "rtapi_app.h"
#include "hal.h"
#include "kinematics.h"

#define MOST_VERTICES 65536
#define MOST_JOINTS 16
#define AXES 9
#define ROUNDS 8
#define LONGEST_LINE 256
#define UNEVEN_MM 1e-6
#define CLOSE 1e-10 /* length units of the machine: where the forward solution stops */

static char *coordinates = "XYZ";
RTAPI_MP_STRING(coordinates, "axis letter of each joint, in order")
static char *lattice = "";
RTAPI_MP_STRING(lattice, "path of lattice.csv")
static int vertices = 0;
RTAPI_MP_INT(vertices, "number of rows that the lattice must have")
static int inch = 0;
RTAPI_MP_INT(inch, "1 where the machine's length unit is the inch")

MODULE_LICENSE("GPL");

typedef struct {
    hal_bit_t *enable;
    hal_bit_t *active;
    hal_float_t *weight;
    hal_float_t slew; /* um per second, of the joint that is corrected most */
    hal_u32_t vertices;
} pins_t;

static int component_id;
static pins_t *pins;

static double low[3], step[3]; /* machine units */
static int count[3];
static double vector[MOST_VERTICES][3]; /* machine units */
static double largest;                  /* machine units */
static double share;                    /* 0 off .. 1 on: written by update() alone */
static int axis_of[MOST_JOINTS], joints;

static int refuse(const char *why, long row)
{
    rtapi_print_msg(RTAPI_MSG_ERR, "stepdiagkins: %s: %s (row %ld): not loaded\n", lattice, why, row);
    return -EINVAL;
}

/* The place of row n of a lattice whose z runs fastest. */
static void place_of(long n, int at[3])
{
    at[2] = (int)(n % count[2]);
    at[1] = (int)(n / count[2] % count[1]);
    at[0] = (int)(n / ((long)count[1] * count[2]));
}

/* Take one row: positions in mm, vectors in um, both turned into machine units. */
static int row_read(FILE *file, double place[3], double moved[3])
{
    char line[LONGEST_LINE];
    double unit = inch ? 25.4 : 1.0;
    int i;
    char rest;

    if (!fgets(line, sizeof line, file) || !strchr(line, '\n'))
        return 0;
    if (sscanf(line, "%lf,%lf,%lf,%lf,%lf,%lf %c", &place[0], &place[1], &place[2], &moved[0], &moved[1], &moved[2], &rest) != 6)
        return 0;
    for (i = 0; i < 3; i++) {
        if (!isfinite(place[i]) || !isfinite(moved[i]) || fabs(moved[i]) > 1000.0)
            return 0;
        place[i] /= unit;
        moved[i] /= 1000.0 * unit;
    }
    return 1;
}

/* Find count, low and step of each axis from the positions; refuse what is no even lattice, z fastest. */
static int measured(double (*place)[3])
{
    long n;
    int i, at[3];

    memcpy(low, place[0], sizeof low);
    for (count[2] = 1; count[2] < vertices && place[count[2]][2] > place[count[2] - 1][2];)
        count[2]++;
    for (count[1] = 1; (long)count[1] * count[2] < vertices && place[count[1] * count[2]][1] > place[(count[1] - 1) * count[2]][1];)
        count[1]++;
    count[0] = vertices / (count[1] * count[2]);
    if (count[0] < 2 || count[1] < 2 || count[2] < 2 || (long)count[0] * count[1] * count[2] != vertices)
        return refuse("no complete lattice, z fastest", vertices);
    step[0] = (place[vertices - 1][0] - low[0]) / (count[0] - 1);
    step[1] = (place[vertices - 1][1] - low[1]) / (count[1] - 1);
    step[2] = (place[vertices - 1][2] - low[2]) / (count[2] - 1);
    for (n = 0; n < vertices; n++) {
        place_of(n, at);
        for (i = 0; i < 3; i++)
            if (!(step[i] > 0.0) || fabs(place[n][i] - low[i] - at[i] * step[i]) > UNEVEN_MM)
                return refuse("not evenly spaced", n + 1);
    }
    return 0;
}

static int loaded(void)
{
    static double place[MOST_VERTICES][3];
    char line[LONGEST_LINE];
    FILE *file;
    long n;
    int i;

    if (vertices < 8 || vertices > MOST_VERTICES)
        return refuse("vertices must be 8 to 65536", vertices);
    file = fopen(lattice, "r");
    if (!file)
        return refuse("cannot be read", 0);
    if (!fgets(line, sizeof line, file) || strncmp(line, "x_mm,y_mm,z_mm,cx_um,cy_um,cz_um", 32) != 0) {
        fclose(file);
        return refuse("is no lattice of stepdiag", 0);
    }
    for (n = 0; n < vertices; n++) {
        if (!row_read(file, place[n], vector[n])) {
            fclose(file);
            return refuse("is damaged or cut off", n + 1);
        }
        for (i = 0; i < 3; i++)
            if (fabs(vector[n][i]) > largest)
                largest = fabs(vector[n][i]);
    }
    i = fgetc(file);
    fclose(file);
    if (i != EOF)
        return refuse("has more rows than vertices= says", vertices + 1);
    return measured(place);
}

/* What the lattice holds at a point: trilinear, faces held. Always eight vertices, never outside the array. */
static void interpolated(const double point[3], double moved[3])
{
    long base[3];
    double part[3];
    int i, corner;

    for (i = 0; i < 3; i++) {
        double along = (point[i] - low[i]) / step[i];
        if (!(along > 0.0))
            along = 0.0; /* a position that is no number ends here too */
        if (along > count[i] - 1)
            along = count[i] - 1;
        base[i] = (long)along;
        if (base[i] > count[i] - 2)
            base[i] = count[i] - 2;
        part[i] = along - base[i];
    }
    moved[0] = moved[1] = moved[2] = 0.0;
    for (corner = 0; corner < 8; corner++) {
        int x = corner & 1, y = corner >> 1 & 1, z = corner >> 2;
        double weight = (x ? part[0] : 1.0 - part[0]) * (y ? part[1] : 1.0 - part[1]) * (z ? part[2] : 1.0 - part[2]);
        const double *at = vector[((base[0] + x) * count[1] + base[1] + y) * count[2] + base[2] + z];
        for (i = 0; i < 3; i++)
            moved[i] += weight * at[i];
    }
    for (i = 0; i < 3; i++)
        moved[i] *= share;
}

static double *axis_in(EmcPose *pose, int axis)
{
    double *each[AXES] = {&pose->tran.x, &pose->tran.y, &pose->tran.z, &pose->a, &pose->b, &pose->c, &pose->u, &pose->v, &pose->w};

    return each[axis];
}

int kinematicsInverse(const EmcPose *world, double *joint, const KINEMATICS_INVERSE_FLAGS *iflags, KINEMATICS_FORWARD_FLAGS *fflags)
{
    EmcPose pose = *world;
    double moved[3];
    int each;

    (void)iflags;
    (void)fflags;
    interpolated((double[3]){world->tran.x, world->tran.y, world->tran.z}, moved);
    for (each = 0; each < joints; each++)
        joint[each] = *axis_in(&pose, axis_of[each]) + (axis_of[each] < 3 ? moved[axis_of[each]] : 0.0);
    return 0;
}

int kinematicsForward(const double *joint, EmcPose *world, const KINEMATICS_FORWARD_FLAGS *fflags, KINEMATICS_INVERSE_FLAGS *iflags)
{
    double stands[AXES] = {0.0}, point[3], moved[3], left = 1.0;
    int each, round, i;

    (void)fflags;
    (void)iflags;
    for (each = joints - 1; each >= 0; each--) /* of two joints of one axis the first one tells */
        stands[axis_of[each]] = joint[each];
    memcpy(point, stands, sizeof point);
    for (round = 0; round < ROUNDS && left > CLOSE; round++) {
        interpolated(point, moved);
        for (left = 0.0, i = 0; i < 3; i++) {
            double next = stands[i] - moved[i];
            left = fmax(left, fabs(next - point[i]));
            point[i] = next;
        }
    }
    memcpy(stands, point, sizeof point);
    for (i = 0; i < AXES; i++)
        *axis_in(world, i) = stands[i];
    return 0;
}

int kinematicsHome(EmcPose *world, double *joint, KINEMATICS_FORWARD_FLAGS *fflags, KINEMATICS_INVERSE_FLAGS *iflags)
{
    *fflags = 0;
    *iflags = 0;
    return kinematicsForward(joint, world, fflags, iflags);
}

KINEMATICS_TYPE kinematicsType(void)
{
    return KINEMATICS_BOTH;
}

KINS_NOT_SWITCHABLE
EXPORT_SYMBOL(kinematicsType);
EXPORT_SYMBOL(kinematicsForward);
EXPORT_SYMBOL(kinematicsInverse);
EXPORT_SYMBOL(kinematicsHome);

/* Once a cycle: bring the compensation in or out at the speed that `slew` allows. */
static void update(void *nothing, long period_ns)
{
    double unit = inch ? 25.4 : 1.0;
    double most = pins->slew > 0.0 && largest > 0.0 ? pins->slew * 1e-3 / unit * period_ns * 1e-9 / largest : 1.0;
    double wanted = *pins->enable ? 1.0 : 0.0;

    (void)nothing;
    share = fmin(fmax(wanted, share - most), share + most);
    *pins->weight = share;
    *pins->active = share == 1.0;
}

static int letters_read(void)
{
    const char *known = "XYZABCUVW", *found;
    int seen[AXES] = {0};

    for (joints = 0; coordinates[joints]; joints++) {
        found = strchr(known, coordinates[joints] & ~0x20);
        if (!found || joints == MOST_JOINTS)
            return -EINVAL;
        axis_of[joints] = (int)(found - known);
        seen[axis_of[joints]] = 1;
    }
    return seen[0] && seen[1] && seen[2] ? 0 : -EINVAL;
}

static int exported(void)
{
    pins = hal_malloc(sizeof *pins);
    if (!pins)
        return -ENOMEM;
    memset(pins, 0, sizeof *pins);
    pins->slew = 100.0;
    pins->vertices = (hal_u32_t)vertices;
    if (hal_pin_bit_newf(HAL_IN, &pins->enable, component_id, "stepdiagkins.enable")
        || hal_pin_bit_newf(HAL_OUT, &pins->active, component_id, "stepdiagkins.active")
        || hal_pin_float_newf(HAL_OUT, &pins->weight, component_id, "stepdiagkins.weight")
        || hal_param_float_newf(HAL_RW, &pins->slew, component_id, "stepdiagkins.slew-um-per-second")
        || hal_param_u32_newf(HAL_RO, &pins->vertices, component_id, "stepdiagkins.vertices")
        || hal_export_funct("stepdiagkins.update", update, NULL, 1, 0, component_id))
        return -EINVAL;
    return 0;
}

int rtapi_app_main(void)
{
    int failed;

    component_id = hal_init("stepdiagkins");
    if (component_id < 0)
        return component_id;
    failed = letters_read();
    if (failed)
        rtapi_print_msg(RTAPI_MSG_ERR, "stepdiagkins: coordinates=%s: needs X, Y and Z, a letter for each joint\n", coordinates);
    failed = failed ? failed : loaded();
    failed = failed ? failed : exported();
    if (failed) {
        hal_exit(component_id);
        return failed;
    }
    hal_ready(component_id);
    return 0;
}

void rtapi_app_exit(void)
{
    hal_exit(component_id);
}
