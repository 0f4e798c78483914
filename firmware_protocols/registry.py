"""The registry of devices: those of this package, of installed packages, and of files, each imported on first use."""

from __future__ import annotations

from typing import TYPE_CHECKING

from firmware_protocols.named_classes import NamedClasses, WrongClassError

if TYPE_CHECKING:  # names of devices must not wait for the import of numpy
    from firmware_protocols.device import Device

_HERE = "firmware_protocols.devices"
DEVICES: dict[str, str] = {
    # name: "module:Class", sorted
    "ability_hand": f"{_HERE}.ability_hand:AbilityHand",
    "agibot_omnihand_o10": f"{_HERE}.agibot_omnihand:AgibotOmniHandO10",
    "agibot_omnihand_pro": f"{_HERE}.agibot_omnihand:AgibotOmniHandPro",
    "aidin_aft200": f"{_HERE}.aidin_aft200:AidinAft200",
    "allegro_v5_plus": f"{_HERE}.allegro_v5_plus:AllegroV5Plus",
    "allegro_v5_sense": f"{_HERE}.allegro_v5_sense:AllegroV5Sense",
    "anyskin": f"{_HERE}.anyskin:AnySkin",
    "ati_net_ft": f"{_HERE}.ati_net_ft:AtiNetFt",
    "ati_netcanoem": f"{_HERE}.ati_netcanoem:AtiNetcanoem",
    "ati_wireless_ft": f"{_HERE}.ati_wireless_ft:AtiWirelessFt",
    "barrett_bh8": f"{_HERE}.barrett_bh8:BarrettBh8",
    "bielefeld_glove": f"{_HERE}.bielefeld_glove:BielefeldGlove",
    "bota_sensone": f"{_HERE}.bota_sensone:BotaSensone",
    "brainco_revo2": f"{_HERE}.brainco_revo2:BraincoRevo2",
    "brainco_revo2_canfd": f"{_HERE}.brainco_revo2:BraincoRevo2CanFd",
    "brainco_revo3": f"{_HERE}.brainco_revo3:BraincoRevo3",
    "brainco_revo3_canfd": f"{_HERE}.brainco_revo3:BraincoRevo3CanFd",
    "contactile_papillarray": f"{_HERE}.contactile_papillarray:ContactilePapillArray",
    "cyskin_cpm_finger": f"{_HERE}.cyskin_cpm_finger:CyskinCpmFinger",
    "dexrobot_dexhand": f"{_HERE}.dexrobot_dexhand:DexrobotDexHand",
    "dfrobot_tactile": f"{_HERE}.dfrobot_tactile:DfrobotTactile",
    "digity_exohand": f"{_HERE}.digity_exohand:DigityExohand",
    "dynpick": f"{_HERE}.dynpick:DynPick",
    "eflesh_binary": f"{_HERE}.eflesh_binary:EfleshBinary",
    "feetech_sts3215": f"{_HERE}.feetech_sts3215:FeetechSts3215",
    "flexitac": f"{_HERE}.flexitac:FlexiTac",
    "fulai_glove": f"{_HERE}.fulai_glove:FulaiGlove",
    "ghand5": f"{_HERE}.ghand5:GHand5",
    "harp_loadcells": f"{_HERE}.harp_loadcells:HarpLoadCells",
    "icub_inertials": f"{_HERE}.icub_inertials:IcubInertials",
    "icub_skin": f"{_HERE}.icub_skin:IcubSkin",
    "icub_strain": f"{_HERE}.icub_strain:IcubStrain",
    "imada_zt": f"{_HERE}.imada_zt:ImadaZt",
    "inspire_rh56dftp": f"{_HERE}.inspire_rh56dftp:InspireRh56dftp",
    "kunwei_kwr75": f"{_HERE}.kunwei_kwr75:KunweiKwr75",
    "kata_hand": f"{_HERE}.kata_hand:KataHand",
    "leptrino_cfs": f"{_HERE}.leptrino_cfs:LeptrinoCfs",
    "linker_hand_g20": f"{_HERE}.linker_hand:LinkerHandG20",
    "linker_hand_l10": f"{_HERE}.linker_hand:LinkerHandL10",
    "linker_hand_l10_rs485": f"{_HERE}.linker_hand_rs485:LinkerHandL10Rs485",
    "linker_hand_l20": f"{_HERE}.linker_hand:LinkerHandL20",
    "linker_hand_l21": f"{_HERE}.linker_hand:LinkerHandL21",
    "linker_hand_l25": f"{_HERE}.linker_hand:LinkerHandL25",
    "linker_hand_l30": f"{_HERE}.linker_hand_l30:LinkerHandL30",
    "linker_hand_l6": f"{_HERE}.linker_hand:LinkerHandL6",
    "linker_hand_l7": f"{_HERE}.linker_hand:LinkerHandL7",
    "linker_hand_o20": f"{_HERE}.linker_hand_o20:LinkerHandO20",
    "linker_hand_o30": f"{_HERE}.linker_hand_o30:LinkerHandO30",
    "linker_hand_o6": f"{_HERE}.linker_hand:LinkerHandO6",
    "loadstar_di": f"{_HERE}.loadstar_di:LoadstarDi",
    "m1616_array": f"{_HERE}.m1616_array:M1616Array",
    "mark10": f"{_HERE}.mark10:Mark10",
    "matsense": f"{_HERE}.matsense:MatSense",
    "me_gsv8": f"{_HERE}.me_gsv8:MeGsv8",
    "nibotics_prvs01": f"{_HERE}.nibotics_prvs01:NiboticsPrvs01",
    "onrobot_hex": f"{_HERE}.ati_net_ft:OnrobotHex",
    "onrobot_rg2_ft": f"{_HERE}.onrobot_rg2_ft:OnrobotRg2Ft",
    "optoforce": f"{_HERE}.optoforce:OptoForce",
    "optoforce_can": f"{_HERE}.optoforce:OptoForceCan",
    "orca_touch": f"{_HERE}.paxini_high_speed:OrcaTouch",
    "osmo_glove": f"{_HERE}.osmo_glove:OsmoGlove",
    "paxini_gen2": f"{_HERE}.paxini_gen2:PaxiniGen2",
    "paxini_high_speed": f"{_HERE}.paxini_high_speed:PaxiniHighSpeed",
    "paxini_px6ax": f"{_HERE}.paxini_px6ax:PaxiniPx6ax",
    "resense_hex": f"{_HERE}.resense_hex:ResenseHex",
    "robotera_xhand": f"{_HERE}.robotera_xhand:RoboteraXhand",
    "robotiq_ft300": f"{_HERE}.robotiq_ft300:RobotiqFt300",
    "robotiq_tsf85": f"{_HERE}.robotiq_tsf85:RobotiqTsf85",
    "robotis_hx5": f"{_HERE}.robotis_hx5:RobotisHx5",
    "robotous_rft": f"{_HERE}.robotous_rft:RobotousRft",
    "rohand": f"{_HERE}.rohand:RoHand",
    "rohand_can": f"{_HERE}.rohand_can:RohandCan",
    "schunk_fts": f"{_HERE}.schunk_fts:SchunkFts",
    "seed_fts3": f"{_HERE}.seed_fts3:SeedFts3",
    "sensel_morph": f"{_HERE}.sensel_morph:SenselMorph",
    "sensing_tex_mat": f"{_HERE}.sensing_tex_mat:SensingTexMat",
    "singletact": f"{_HERE}.singletact:SingleTact",
    "sun_fingertip": f"{_HERE}.sun_fingertip:SunFingertip",
    "sunrise_m8128": f"{_HERE}.sunrise_m8128:SunriseM8128",
    "synria_60": f"{_HERE}.synria_60:Synria60",
    "tams_array": f"{_HERE}.tams_array:TamsArray",
    "tesollo_dg": f"{_HERE}.tesollo_dg:TesolloDg",
    "unitree_dex3": f"{_HERE}.unitree_dex3:UnitreeDex3",
    "vitac_3d": f"{_HERE}.flexitac:ViTac3d",
    "weiss_dsacon32m": f"{_HERE}.weiss_dsacon32m:WeissDsacon32m",
    "weiss_wts": f"{_HERE}.weiss_wts:WeissWts",
    "wiresens": f"{_HERE}.wiresens:Wiresens",
    "xela_server": f"{_HERE}.xela_server:XelaServer",
    "xela_uskin": f"{_HERE}.xela_uskin:XelaUskin",
    "xela_uskin_4x6": f"{_HERE}.xela_uskin:XelaUskin4x6",
}

REGISTRY = NamedClasses(
    "device", "tactemu.devices", DEVICES, "firmware_protocols.device:Device", listing="`tactemu devices`"
)


def names() -> list[str]:
    """Return the name of every device, those of installed packages included."""
    return REGISTRY.names()


def device_class(name: str) -> type[Device]:
    """Return the device class called ``name``: a registered name, or ``path/to/file.py:Class``.

    Raises:
        LookupError: there is no such device; the message names the nearest.
        TypeError: the object is no device class, or one of the contract's first version.
    """
    found = REGISTRY.load(name)
    if hasattr(found, "digitize"):
        raise WrongClassError(
            f"{name} is written for the first version of the contract: rename digitize(reading) to "
            "measure(reading, t_ns) and return the counts, wires to ports, put power_on into __init__, and see "
            "docs/adding-a-device.md (installed: tactemu/docs)"
        )
    if hasattr(found, "feel"):
        raise WrongClassError(f"{name}: rename feel(reading, t_ns) to measure(reading, t_ns)")
    if not isinstance(getattr(found, "name", None), str):
        raise WrongClassError(f'{name} has no name: write `name = "..."` in the class, in lower case with underscores')
    return found


def create(name: str, **options) -> Device:
    """Return a new device by name, just powered up, with its options (see the class).

    Raises:
        LookupError: there is no such device.
        ValueError: the device has no such option, or its value is invalid.
    """
    from firmware_protocols.options import checked

    found = device_class(name)
    return found(**checked(found, options))
