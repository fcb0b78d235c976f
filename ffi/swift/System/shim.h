#include <svbrdf.h>
