/*
 * camera_xml: the text of camera.xml, built into the program.
 * Layer: sim. Threads: any. Ownership: static.
 */
#ifndef LS_SIM_CAMERA_XML_H
#define LS_SIM_CAMERA_XML_H

#include <stddef.h>

extern const unsigned char sim_camera_xml[];
extern const size_t sim_camera_xml_bytes;

#endif
