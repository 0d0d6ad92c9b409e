/* A library in the place of NVML for sensors_test.cpp: three GPUs whose sensors answer in different ways. */
#include <string.h>

typedef struct {
  unsigned version, sensor;
  int celsius;
} Temperature;

enum { kSuccess = 0, kNotFound = 6, kNotSupported = 3, kVersionMismatch = 25 };
static int devices[3];

int fake_users = 0; /* initialised and not shut down */

int nvmlInit_v2(void) { return ++fake_users, kSuccess; }
int nvmlShutdown(void) { return --fake_users, kSuccess; }

int nvmlDeviceGetHandleByPciBusId_v2(const char* id, void** device) {
  static const char* const ids[] = {"0000:1A:00.0", "0000:1B:00.0", "0000:1C:00.0"};
  for (int k = 0; k < 3; ++k)
    if (strcmp(id, ids[k]) == 0) return *device = &devices[k], kSuccess;
  return kNotFound;
}

/* 1A: answers; 1B: as an old driver, through the old function alone; 1C: has no sensor. */
int nvmlDeviceGetTemperatureV(void* device, Temperature* t) {
  if (device != &devices[0] || t->sensor != 0) return kNotSupported;
  if (t->version != (sizeof(Temperature) | 1 << 24)) return kVersionMismatch;
  return t->celsius = 41, kSuccess;
}
int nvmlDeviceGetTemperature(void* device, unsigned sensor, unsigned* celsius) {
  if (device != &devices[1] || sensor != 0) return kNotSupported;
  return *celsius = 52, kSuccess;
}
