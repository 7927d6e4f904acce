/* Closed loops of the tree in tree.c: its closures are equations of the coordinates, phi(q) = 0, G = d phi / d q.
 *
 * Joints that the motion leaves out follow by Newton's method, their rates and accelerations by G; efforts of the drives are what is
 * left of the open tree's along the motions that G allows, with the least sum of weight tau^2.  Redundant equations are told by
 * complete pivoting. */

typedef struct {
    int points, across, link[2]; /* equations: 3 of a point, 2 of axes, else 1 of a coupling; links of its ends, -1: the world */
    double place[2][3], axes[2][3], along[3], factor[COUNT], offset;
} Tie;
#include "ties.h"

#define SMALL 1e-9 /* of the largest pivot: an equation that says nothing new */
#define ITERATIONS 60
typedef struct { double phi[ROWS], g[ROWS][COUNT], second[ROWS]; } Equations;

static void seat_of(const Seat *seats, int link, Seat *s) {
    if (link >= 0) { *s = seats[link]; return; }
    memset(s, 0, sizeof *s);
    for (int i = 0; i < 3; i++) { s->r[4 * i] = 1.0; s->acc[i] = -GRAVITY[i]; }
}
static int carries(int joint, int link) {
    while (link > joint) link = JOINTS[link].parent;
    return link == joint;
}
static void across(const Seat *two, const double *u, const Seat *one, const double *w, double *second) { /* (u w)'' */
    double a[3], b[3];
    carry(two->w, two->alpha, w, memset(a, 0, sizeof a));
    carry(one->w, one->alpha, u, memset(b, 0, sizeof b));
    *second = dot(u, a) + dot(w, b);
    cross(one->w, u, a);
    cross(two->w, w, b);
    *second += 2.0 * dot(a, b);
}
static void equations(const Seat *seats, const double *q, const double *acc, Equations *e) {
    int row = 0;
    memset(e, 0, sizeof *e);
    for (const Tie *t = TIES; t < TIES + CLOSED; t++) {
        Seat s[2];
        double d[2][3], x[2][3], a[2][3], u[3], w[3], n[3];
        for (int end = 0; end < 2; end++) {
            seat_of(seats, t->link[end], &s[end]);
            times(s[end].r, t->place[end], d[end]);
            memcpy(a[end], s[end].acc, sizeof a[end]);
            carry(s[end].w, s[end].alpha, d[end], a[end]);
            for (int i = 0; i < 3; i++) x[end][i] = s[end].x[i] + d[end][i];
        }
        for (int i = 0; i < 3 * t->points; i++) { e->phi[row + i] = x[1][i] - x[0][i]; e->second[row + i] = a[1][i] - a[0][i]; }
        for (int k = 0; k < COUNT && t->points; k++) {
            for (int end = 0; end < 2; end++) {
                if (!carries(k, t->link[end])) continue;
                double arm[3], column[3];
                for (int i = 0; i < 3; i++) arm[i] = x[end][i] - seats[k].x[i];
                cross(seats[k].axis, arm, column);
                for (int i = 0; i < 3; i++) e->g[row + i][k] += (end ? 1 : -1) * (JOINTS[k].slides ? seats[k].axis[i] : column[i]);
            }
        }
        row += 3 * t->points;
        for (int i = 0; i < t->across; i++, row++) {
            times(s[0].r, t->axes[i], u);
            times(s[1].r, t->along, w);
            cross(w, u, n);
            e->phi[row] = dot(u, w);
            across(&s[1], u, &s[0], w, &e->second[row]);
            for (int k = 0; k < COUNT; k++)
                if (!JOINTS[k].slides) e->g[row][k] = (carries(k, t->link[1]) - carries(k, t->link[0])) * dot(n, seats[k].axis);
        }
        if (t->points) continue;
        e->phi[row] = -t->offset;
        for (int k = 0; k < COUNT; k++) {
            e->g[row][k] = t->factor[k];
            e->phi[row] += t->factor[k] * q[k];
            e->second[row] += t->factor[k] * acc[k];
        }
        row++;
    }
}

/* Gauss and Jordan with complete pivoting of (rows, cols | 1): columns[r] is the pivot of row r; returns the rank. */
static int reduced(int rows, int cols, double m[][COUNT + 1], int *columns) {
    double largest = 0.0;
    for (int rank = 0;; rank++) {
        int pr = rank, pc = -1;
        double best = rank ? SMALL * largest : 0.0;
        for (int r = rank; r < rows; r++)
            for (int c = 0; c < cols; c++) if (fabs(m[r][c]) > best) { best = fabs(m[r][c]); pr = r; pc = c; }
        if (pc < 0) return rank;
        if (!rank) largest = best;
        columns[rank] = pc;
        for (int c = 0; c <= cols; c++) {
            const double swap = m[pr][c];
            m[pr][c] = m[rank][c];
            m[rank][c] = swap;
        }
        for (int c = 0; c <= cols; c++) if (c != pc) m[rank][c] /= m[rank][pc];
        m[rank][pc] = 1.0;
        for (int r = 0; r < rows; r++) {
            if (r == rank) continue;
            const double part = m[r][pc];
            for (int c = 0; c <= cols; c++) m[r][c] -= part * m[rank][c];
            m[r][pc] = 0.0;
        }
    }
}
/* x of the joints that are not given: G x = -right. */
static double followed(const Equations *e, const double *right, double *x) {
    double m[ROWS][COUNT + 1], size = 0.0;
    int columns[ROWS + 1], free[COUNT], n = 0;
    for (int k = 0; k < COUNT; k++) if (!GIVEN[k]) free[n++] = k;
    for (int r = 0; r < ROWS; r++) {
        for (int k = 0; k < n; k++) m[r][k] = e->g[r][free[k]];
        m[r][n] = -right[r];
    }
    const int rank = reduced(ROWS, n, m, columns);
    for (int k = 0; k < n; k++) x[free[k]] = 0.0;
    for (int r = 0; r < rank; r++) { x[free[columns[r]]] = m[r][n]; size = fmax(size, fabs(m[r][n])); }
    return size;
}
/* Efforts of the drives, from those of the open tree. */
static void shared(const Equations *e, double *tau) {
    double m[ROWS][COUNT + 1], z[COUNT][COUNT] = {{0}}, s[COUNT][COUNT + 1] = {{0}}, y[COUNT] = {0};
    int columns[ROWS + 1], pivot[COUNT] = {0}, dof = 0;
    for (int r = 0; r < ROWS; r++) { memcpy(m[r], e->g[r], sizeof e->g[r]); m[r][COUNT] = 0.0; }
    const int rank = reduced(ROWS, COUNT, m, columns);
    for (int r = 0; r < rank; r++) pivot[columns[r]] = 1;
    for (int c = 0; c < COUNT; c++) {
        if (pivot[c]) continue;
        z[dof][c] = 1.0;
        for (int r = 0; r < rank; r++) z[dof][columns[r]] = -m[r][c];
        dof++;
    }
    for (int i = 0; i < dof; i++) {
        for (int j = 0; j < dof; j++) for (int k = 0; k < COUNT; k++) if (DRIVEN[k]) s[i][j] += z[i][k] * z[j][k] / WEIGHT[k];
        for (int k = 0; k < COUNT; k++) s[i][dof] += z[i][k] * tau[k];
    }
    const int found = reduced(dof, dof, s, columns);
    for (int r = 0; r < found; r++) y[columns[r]] = s[r][dof];
    for (int k = 0; k < COUNT; k++) {
        tau[k] = 0.0;
        for (int i = 0; i < dof && DRIVEN[k]; i++) tau[k] += z[i][k] * y[i] / WEIGHT[k];
    }
}
/* Efforts of the closed loop; q, v, a of joints that are not given are found, q from where it stands.  Returns 0 where it does not close. */
static int closed(double *q, double *v, double *a, double *tau) {
    Seat seats[COUNT];
    Equations e;
    double step[COUNT] = {0}, right[ROWS], moved = 1.0;
    const double none[COUNT] = {0};
    for (int n = 0; n < ITERATIONS && moved > 1e-14; n++) {
        inverse(q, none, none, tau, seats);
        equations(seats, q, none, &e);
        moved = followed(&e, e.phi, step);
        for (int k = 0; k < COUNT; k++) if (!GIVEN[k]) q[k] += step[k];
    }
    for (int k = 0; k < COUNT; k++) if (!GIVEN[k]) v[k] = a[k] = 0.0;
    inverse(q, v, a, tau, seats);
    equations(seats, q, a, &e);
    for (int r = 0; r < ROWS; r++) {
        if (!(fabs(e.phi[r]) < SMALL)) return 0;
        right[r] = 0.0;
        for (int k = 0; k < COUNT; k++) right[r] += e.g[r][k] * v[k];
    }
    followed(&e, right, v);
    inverse(q, v, a, tau, seats);
    equations(seats, q, a, &e);
    followed(&e, e.second, a);
    inverse(q, v, a, tau, seats);
    shared(&e, tau);
    return 1;
}
