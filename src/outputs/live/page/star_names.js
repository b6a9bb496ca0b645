// Names of the brightest stars by their number in the Hipparcos catalog: names approved by the International Astronomical
// Union.

const STAR_NAMES = {
  32349: "Sirius", 30438: "Canopus", 71683: "Rigil Kentaurus", 69673: "Arcturus", 91262: "Vega", 24608: "Capella",
  24436: "Rigel", 37279: "Procyon", 7588: "Achernar", 27989: "Betelgeuse", 68702: "Hadar", 97649: "Altair",
  60718: "Acrux", 21421: "Aldebaran", 65474: "Spica", 80763: "Antares", 37826: "Pollux", 113368: "Fomalhaut",
  102098: "Deneb", 62434: "Mimosa", 49669: "Regulus", 33579: "Adhara", 36850: "Castor", 61084: "Gacrux",
  85927: "Shaula", 25336: "Bellatrix", 25428: "Elnath", 45238: "Miaplacidus", 26311: "Alnilam", 109268: "Alnair",
  26727: "Alnitak", 62956: "Alioth", 54061: "Dubhe", 15863: "Mirfak", 34444: "Wezen", 90185: "Kaus Australis",
  86228: "Sargas", 41037: "Avior", 67301: "Alkaid", 28360: "Menkalinan", 82273: "Atria", 31681: "Alhena",
  100751: "Peacock", 42913: "Alsephina", 30324: "Mirzam", 46390: "Alphard", 11767: "Polaris", 9884: "Hamal",
  50583: "Algieba", 3419: "Diphda", 92855: "Nunki", 68933: "Menkent", 5447: "Mirach", 677: "Alpheratz",
  86032: "Rasalhague", 72607: "Kochab", 27366: "Saiph", 57632: "Denebola", 14576: "Algol", 25930: "Mintaka",
  44816: "Suhail", 39429: "Naos", 76267: "Alphecca", 65378: "Mizar", 87833: "Eltanin", 3179: "Schedar",
};

// Returns the name of a star of the truth, or nothing.
function nameOf(star) {
  const found = /^HIP (\d+)$/.exec(star.source_id || "");
  return found ? STAR_NAMES[found[1]] : undefined;
}
