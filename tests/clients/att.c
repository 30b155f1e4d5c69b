/* Headings by gpsd's own library for C: gcc att.c -lgps -lm; ./a.out HOST PORT */
#include <gps.h>
#include <math.h>
#include <stdio.h>

int main(int count, char **arguments)
{
    struct gps_data_t data;
    if (count != 3 || gps_open(arguments[1], arguments[2], &data) != 0)
        return 1;
    gps_stream(&data, WATCH_ENABLE | WATCH_JSON, NULL);
    for (int left = 100; left > 0 && gps_waiting(&data, 5000000);) {
        if (gps_read(&data, NULL, 0) < 0)
            return 1;
        const struct attitude_t *att = &data.attitude;
        if ((data.set & ATTITUDE_SET) && isfinite(att->heading)) {
            printf("%ld.%03ld true %.2f\n", (long)att->mtime.tv_sec, att->mtime.tv_nsec / 1000000, att->heading);
            left--;
        }
    }
    gps_close(&data);
}
