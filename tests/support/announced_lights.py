"""Announcements and states that real devices have sent, as their users have reported them."""

ZIGBEE_TOPIC = "homeassistant/light/0x0c4314fffe0f8ab6/light/config"
ZIGBEE = b"""{"availability":[{"topic":"zigbee2mqtt/bridge/state","value_template":"{{ value_json.state }}"}],
"brightness":true,"brightness_scale":254,"command_topic":"zigbee2mqtt/cuinaLlumTaulell/set",
"device":{"identifiers":["zigbee2mqtt_0x0c4314fffe0f8ab6"],"manufacturer":"IKEA",
"model":"TRADFRI LED driver, 30 w (ICPSHC24-30EU-IL-1/ICPSHC24-10EU-IL-2)","name":"cuinaLlumTaulell",
"sw_version":"2.3.086","via_device":"zigbee2mqtt_bridge_0x00124b0012c38fda"},"effect":true,
"effect_list":["blink","breathe","okay","channel_change","finish_effect","stop_effect"],"name":null,
"object_id":"cuinallumtaulell","origin":{"name":"Zigbee2MQTT","sw":"1.39.0","url":"https://www.zigbee2mqtt.io"},
"schema":"json","state_topic":"zigbee2mqtt/cuinaLlumTaulell","unique_id":"0x0c4314fffe0f8ab6_light_zigbee2mqtt"}"""
"""Zigbee2MQTT 1.39 (openhab-addons, issue 16633)."""
ZIGBEE_LIGHT = "light.0x0c4314fffe0f8ab6_light_zigbee2mqtt"

TASMOTA_TOPIC = "homeassistant/light/A0424B_LI_1/config"
TASMOTA = b"""{"name":"desk","stat_t":"desk/tele/STATE","avty_t":"desk/tele/LWT","pl_avail":"Online",
"pl_not_avail":"Offline","cmd_t":"desk/cmnd/POWER","val_tpl":"{{value_json.POWER}}","pl_off":"OFF","pl_on":"ON",
"uniq_id":"A0424B_LI_1","dev":{"ids":["A0424B"]},"bri_cmd_t":"desk/cmnd/Dimmer","bri_stat_t":"desk/tele/STATE",
"bri_scl":100,"on_cmd_type":"brightness","bri_val_tpl":"{{value_json.Dimmer}}","rgb_cmd_t":"desk/cmnd/Color2",
"rgb_stat_t":"desk/tele/STATE","rgb_val_tpl":"{{value_json.Color.split(',')[0:3]|join(',')}}",
"fx_cmd_t":"desk/cmnd/Scheme","fx_stat_t":"desk/tele/STATE","fx_val_tpl":"{{value_json.Scheme}}",
"fx_list":["0","1","2","3","4"],"clr_temp_cmd_t":"desk/cmnd/CT","clr_temp_stat_t":"desk/tele/STATE",
"clr_temp_val_tpl":"{{value_json.CT}}","whit_val_cmd_t":"desk/cmnd/White","whit_val_stat_t":"desk/tele/STATE",
"whit_val_scl":100,"whit_val_tpl":"{{value_json.White}}"}"""
TASMOTA_STATE = b"""{"Time":"2020-09-08T18:07:56","Uptime":"0T00:15:13","UptimeSec":913,"Heap":25,
"SleepMode":"Dynamic","Sleep":10,"LoadAvg":99,"MqttCount":1,"POWER":"ON","Dimmer":100,"Color":"0,0,0,59,196",
"HSBColor":"338,0,0","White":100,"CT":420,"Channel":[0,0,0,23,77],"Scheme":0,"Fade":"OFF","Speed":3,
"LedTable":"OFF"}"""
"""A Tasmota bulb with SetOption19 (home-assistant/core, issue 39811)."""

RELAY_TOPIC = "homeassistant/light/NodeMCU1_1/config"
RELAY = b"""{"name":"NodeMCU1 1","command_topic":"cmnd/NodeMCU1/POWER1","state_topic":"stat/NodeMCU1/RESULT",
"value_template":"{{value_json.POWER1}}","payload_off":"OFF","payload_on":"ON",
"availability_topic":"tele/NodeMCU1/LWT","payload_available":"Online","payload_not_available":"Offline"}"""
"""A Tasmota relay as a light, without what its dimmer has (Tasmota, issue 2348)."""
RELAY_LIGHT = "light.nodemcu1_1_741ed6ae"

ESPHOME_TOPIC = "homeassistant/light/the_tube_light/the_tube_light/config"
ESPHOME = b"""{"brightness":true,"rgb":true,"flash":true,"white_value":true,"name":"The Tube Light",
"state_topic":"the_tube_light/light/the_tube_light/state",
"command_topic":"the_tube_light/light/the_tube_light/command","availability_topic":"the_tube_light/status",
"unique_id":"ESPlightthe_tube_light","device":{"identifiers":"5ccf7fe027f0","name":"the_tube_light",
"sw_version":"esphomelib v1.10.1 Jan 19 2019, 22:00:52","model":"PLATFORMIO_ESP12E",
"manufacturer":"espressif"},"schema":"json"}"""
"""ESPHome 1.10 (home-assistant/core, issue 20823)."""

ZWAVE_TOPIC = "homeassistant/light/study/config"
ZWAVE = b"""{"name":"In_wall_study_switch",
"command_topic":"zwave/_CLIENTS/ZWAVE_GATEWAY-Mos_mqtt/api/setValue/set",
"availability_topic":"zwave/Study/21/status","brightness_command_topic":"zwave/Study/21/38/1/0/set",
"brightness_state_topic":"zwave/Study/21/38/1/0","payload_on":"{ \\"args\\":[21,37,1,0,true]}",
"payload_off":"{ \\"args\\":[21,37,1,0,false]}","state_topic":"zwave/Study/21/37/1/0",
"state_value_template":"{% if value.replace(\\"'\\",'') == true %}{ \\"args\\":[21,37,1,0,true]}{% endif %}",
"brightness_scale":99,"qos":2,"retain":false,"payload_available":"true","payload_not_available":"false",
"unique_id":"study_switch_111","on_command_type":"first","device":{"identifiers":"inwallstudyswitch111"}}"""
"""A light of Zwave2Mqtt whose template is a program (Zwave2Mqtt, issue 40)."""

BULB = b"""{"ip":"192.168.0.10","dn":"Tasmota","fn":["Test",null,null,null,null,null,null,null],
"hn":"tasmota_49A3BC-0956","mac":"00000049A3BC","md":"Sonoff Basic","ty":0,"if":0,
"ofln":"Offline","onln":"Online","state":["OFF","ON","TOGGLE","HOLD"],"sw":"8.4.0.2","t":"tasmota_B94927","ft":"%prefix%/%topic%/",
"tp":["cmnd","stat","tele"],"rl":[2,0,0,0,0,0,0,0],"swc":[-1,-1,-1,-1,-1,-1,-1,-1],"btn":[0,0,0,0],
"so":{"4":0,"11":0,"13":0,"17":0,"20":0,"30":0,"68":0,"73":0,"80":0},"lk":1,"lt_st":1,"ver":1}"""
BULB_STATE = b'{"Time":"2020-09-08T18:07:56","POWER":"OFF","Dimmer":40}'
"""A Tasmota by its own discovery, as in the tests of home-assistant/core (tests/components/tasmota)."""
PLUG = BULB.replace(b'"rl":[2', b'"rl":[1')
SENSOR = b"""{"dev":{"ids":"ea334450945afc","name":"Kitchen"},"o":{"name":"bla2mqtt"},
"cmps":{"some_id1":{"p":"sensor","unique_id":"temp01ae_t"}}}"""
"""A device without a light, from the documentation of Home Assistant's discovery."""
